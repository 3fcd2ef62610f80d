// malus stokes: raw polarization frames to S0, S1, S2, DoLP and AoLP, as data and as pictures.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/image/pack.h"
#include "malus/io/picture_file.h"
#include "malus/polar/demosaick.h"
#include "malus/polar/layout_check.h"
#include "malus/polar/render.h"
#include "malus/polar/stokes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <vector>

#include "flags.h"
#include "frame_input.h"
#include "program.h"
#include "raw_options.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct StokesArguments {
  RawOptions raw;
  RenderSettings render;
  std::vector<fs::path> inputs;
  fs::path folder;
  std::string format = "exr";
  std::string method = "residual";  ///< of demosaicking
  bool pictures = true, full = false;
};

constexpr std::array<const char*, 5> kProducts = {"s0", "s1", "s2", "dolp", "aolp"};

// What one input becomes: a data file and a picture of every product.
struct OutputNames {
  std::array<fs::path, 5> data, picture;
};

std::vector<OutputNames> plan_outputs(const StokesArguments& arguments, bool force) {
  std::vector<OutputNames> plans(arguments.inputs.size());
  for (std::size_t k = 0; k < kProducts.size(); ++k) {
    const std::string suffix = fmt::format("_{}.", kProducts[k]);
    const auto data = output_names(arguments.inputs, arguments.folder, suffix + arguments.format);
    const auto pictures = output_names(arguments.inputs, arguments.folder, suffix + "png");
    for (std::size_t i = 0; i < plans.size(); ++i) {
      plans[i].data[k] = data[i];
      plans[i].picture[k] = pictures[i];
      check_output(data[i], force);
      if (arguments.pictures) check_output(pictures[i], force);
    }
  }
  return plans;
}

// One image of every display channel.
template <class Function>
Planes collect(const StokesPicture& picture, Function image) {
  Planes planes(static_cast<int>(picture.planes.size()), 0, 0);
  for (std::size_t i = 0; i < picture.planes.size(); ++i)
    planes[static_cast<int>(i)] = image(picture.planes[i]);
  return planes;
}

std::array<Planes, 5> data_of(const StokesPicture& picture) {
  return {collect(picture, [](const StokesPlanes& s) { return s.s0; }),
          collect(picture, [](const StokesPlanes& s) { return s.s1; }),
          collect(picture, [](const StokesPlanes& s) { return s.s2; }),
          collect(picture, [](const StokesPlanes& s) { return dolp_of(s); }),
          collect(picture, [](const StokesPlanes& s) { return aolp_deg_of(s); })};
}

std::array<Planes, 5> pictures_of(const StokesPicture& picture, const RenderSettings& settings) {
  const StokesPlanes mean = mean_stokes(picture.planes);
  const Image dolp = dolp_of(mean), aolp = aolp_deg_of(mean);
  SignedPictures differences = render_s1_s2(mean, settings);
  return {render_s0(picture, settings), std::move(differences.s1), std::move(differences.s2),
          render_dolp(dolp, settings), render_aolp(aolp, dolp, settings)};
}

// Mean over the defined pixels, and the share of the others.
Json summary_of(const Planes& dolp) {
  double sum = 0;
  std::size_t defined = 0, all = 0;
  for (const Image& plane : dolp)
    for (float v : plane.values()) {
      ++all;
      if (std::isfinite(v)) sum += v, ++defined;
    }
  Json json;
  json["mean_dolp"] = defined > 0 ? Json(sum / static_cast<double>(defined)) : Json();
  json["undefined"] = all > 0 ? static_cast<double>(all - defined) / static_cast<double>(all) : 0.0;
  return json;
}

void warn_about(const RawFrame& frame, const fs::path& input) {
  const std::string complaint = layout_complaint(frame.layout, check_layout(frame.dn));
  if (!complaint.empty()) warn(fmt::format("{}: {}", input.string(), complaint));
  if (!frame.black_known)
    warn(
        fmt::format("{}: black level not known, taken as 0; DoLP is too low if it is not (--black)",
                    input.string()));
}

// One value per cell, or one per pixel with --full.
StokesPicture stokes_picture(const StokesArguments& arguments, const RawFrame& frame) {
  if (!arguments.full)
    return merge_greens(stokes_per_color(pack(frame.dn, frame.layout), frame.layout), frame.layout);
  const auto method =
      std::find(kDemosaickingNames.begin(), kDemosaickingNames.end(), arguments.method) -
      kDemosaickingNames.begin();
  return demosaick(frame.dn, frame.layout, static_cast<Demosaicking>(method));
}

Json process(const StokesArguments& arguments, const fs::path& input, const FrameOptions& options,
             const OutputNames& names, bool force) {
  const RawFrame frame = load_above_black(input, options);
  require_polarized(frame.layout, input.string());
  warn_about(frame, input);
  const StokesPicture picture = stokes_picture(arguments, frame);
  const std::vector<std::string> channels =
      picture.names.size() == 1 ? std::vector<std::string>{"Y"} : picture.names;
  const std::array<Planes, 5> data = data_of(picture);
  Json json{{"input", input.string()},
            {"layout", frame.layout.name()},
            {"rows", data[0].rows()},
            {"cols", data[0].cols()},
            {"channels", channels}};
  json.update(summary_of(data[3]));
  SaveOptions save;
  save.force = force;
  for (std::size_t k = 0; k < kProducts.size(); ++k) {
    save_picture(names.data[k], data[k], channels, save);
    json["files"].push_back(names.data[k].string());
  }
  if (!arguments.pictures) return json;
  save.type = SampleType::kUint8;
  const std::array<Planes, 5> pictures = pictures_of(picture, arguments.render);
  for (std::size_t k = 0; k < kProducts.size(); ++k) {
    save_picture(names.picture[k], pictures[k], {}, save);
    json["files"].push_back(names.picture[k].string());
  }
  return json;
}

void run_stokes(const StokesArguments& arguments, const Common& common) {
  const FrameOptions options = arguments.raw.resolve();
  make_output_folder(arguments.folder);
  const std::vector<OutputNames> plans = plan_outputs(arguments, common.force);
  const auto progress = make_progress(common);
  progress->begin("stokes", static_cast<std::int64_t>(arguments.inputs.size()));
  Json results = Json::array();
  std::string text;
  for (std::size_t i = 0; i < arguments.inputs.size(); ++i) {
    check_stop(*progress);
    results.push_back(process(arguments, arguments.inputs[i], options, plans[i], common.force));
    const Json& last = results.back();
    text += fmt::format(
        "{}: {} x {} {}, mean DoLP {:.3f}, undefined {:.2f} %, {} files in {}\n",
        arguments.inputs[i].string(), last["cols"].get<int>(), last["rows"].get<int>(),
        last["layout"].get<std::string>(),
        last["mean_dolp"].is_null() ? std::nan("") : last["mean_dolp"].get<double>(),
        100 * last["undefined"].get<double>(), last["files"].size(), arguments.folder.string());
    progress->advance(1);
  }
  print_result(common, results.size() == 1 ? results[0] : Json{{"frames", results}}, text);
}

}  // namespace

void add_stokes(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<StokesArguments>();
  CLI::App* command =
      add_command(app, common, "stokes", "S0, S1, S2, DoLP and AoLP of raw polarization frames",
                  [arguments, &common] { run_stokes(*arguments, common); });
  command->add_option("RAW", arguments->inputs, "polarization mosaics")->required();
  command->add_option("-o,--output", arguments->folder, "folder of the results")->required();
  command->add_option("--format", arguments->format, "ending of the data files")
      ->check(CLI::IsMember({"exr", "tif", "npy", "fits"}))
      ->capture_default_str();
  command->add_flag("!--no-pictures", arguments->pictures, "data files only");
  command->add_flag("--full", arguments->full,
                    "one value per pixel by demosaicking, instead of one per cell");
  command->add_option("--demosaick", arguments->method, "how --full fills the gaps")
      ->check(CLI::IsMember(
          std::vector<std::string>(kDemosaickingNames.begin(), kDemosaickingNames.end())))
      ->capture_default_str();
  arguments->raw.add_to(*command);
  add_flags(*command, arguments->render);
}

}  // namespace malus::app
