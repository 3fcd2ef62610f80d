// malus stokes: raw polarization frames to S0, S1, S2, DoLP and AoLP, as data and as pictures.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/image/pack.h"
#include "malus/io/picture_file.h"
#include "malus/polar/demosaick.h"
#include "malus/polar/dolp_summary.h"
#include "malus/polar/render.h"
#include "malus/polar/stokes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "denoise_checks.h"
#include "flags.h"
#include "frame_input.h"
#include "output_check.h"
#include "program.h"
#include "raw_options.h"
#include "stokes_uncertainty.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

constexpr std::array<const char*, 5> kProducts = {"s0", "s1", "s2", "dolp", "aolp"};

// Endings of the data files.
std::vector<std::string> product_formats() { return {"exr", "tif", "npy", "fits"}; }

struct StokesArguments {
  RawOptions raw;
  RenderSettings render;
  std::vector<fs::path> inputs, variance;
  fs::path folder, model;
  std::string format = "exr";
  std::string method = "residual";  ///< of demosaicking
  bool pictures = true, full = false, extrapolate_gain = false, fixed_pattern = true;
  bool confidence() const { return !model.empty() || !variance.empty(); }
  /// Names of what is written for every input.
  std::vector<std::string> products() const {
    std::vector<std::string> names(kProducts.begin(), kProducts.end());
    if (confidence())
      names.insert(names.end(), kConfidenceProducts.begin(), kConfidenceProducts.end());
    return names;
  }
};

// What one input becomes: a data file and a picture of every product.
struct ProductNames {
  std::vector<fs::path> data, picture;  // one per product
  std::vector<fs::path> stale;          // to be removed as the results are replaced
};

std::vector<fs::path> read_besides(const StokesArguments& arguments) {
  std::vector<fs::path> read = arguments.raw.files_read();
  read.insert(read.end(), arguments.variance.begin(), arguments.variance.end());
  read.push_back(arguments.model);
  return read;
}

// What an earlier run may have left beside an input's results and this one does not write: it would
// look like a part of them.
std::vector<fs::path> stale_products(const StokesArguments& arguments, const fs::path& input) {
  std::vector<fs::path> stale, read = read_besides(arguments);
  read.insert(read.end(), arguments.inputs.begin(), arguments.inputs.end());
  const auto add = [&](const char* product, const std::string& format) {
    stale.push_back(arguments.folder / fmt::format("{}_{}.{}", stem_of(input), product, format));
  };
  for (const char* product : kConfidenceProducts) {
    if (!arguments.confidence())
      for (const std::string& format : product_formats()) add(product, format);
    if (!arguments.confidence() || !arguments.pictures) add(product, "png");
  }
  for (const char* product : kProducts)
    if (!arguments.pictures) add(product, "png");
  return existing_apart(stale, read);
}

std::vector<ProductNames> plan_product_files(const StokesArguments& arguments, bool force) {
  const std::vector<fs::path> besides = read_besides(arguments);
  std::vector<fs::path> read = besides;
  read.insert(read.end(), arguments.inputs.begin(), arguments.inputs.end());
  const auto named = [&](const std::string& suffix) {
    return output_names(arguments.inputs, arguments.folder, suffix, besides);
  };
  std::vector<ProductNames> plans(arguments.inputs.size());
  for (const std::string& product : arguments.products()) {
    const std::string suffix = fmt::format("_{}.", product);
    const auto data = named(suffix + arguments.format), pictures = named(suffix + "png");
    for (std::size_t i = 0; i < plans.size(); ++i) {
      plans[i].data.push_back(data[i]);
      plans[i].picture.push_back(pictures[i]);
      check_output(data[i], force);
      if (arguments.pictures) check_output(pictures[i], force);
      for (fs::path& other : left_in_other_formats(data[i], product_formats(), read, force))
        plans[i].stale.push_back(std::move(other));
    }
  }
  for (std::size_t i = 0; i < plans.size() && force; ++i)
    for (fs::path& unwritten : stale_products(arguments, arguments.inputs[i]))
      plans[i].stale.push_back(std::move(unwritten));
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

// Products are made one after the other as they are written: a full-resolution colour frame's are
// several times its size.
using Product = std::function<Planes()>;

std::vector<Product> product_data(const StokesPicture& picture) {
  const auto every = [&picture](auto image) {
    return Product([&picture, image] { return collect(picture, image); });
  };
  return {every([](const StokesPlanes& s) { return s.s0; }),
          every([](const StokesPlanes& s) { return s.s1; }),
          every([](const StokesPlanes& s) { return s.s2; }),
          every([](const StokesPlanes& s) { return dolp_of(s); }),
          every([](const StokesPlanes& s) { return aolp_deg_of(s); })};
}

// S1 to AoLP as pictures, of the mean of the colours.
std::vector<Product> mean_pictures(const StokesPlanes& mean, const RenderSettings& settings) {
  return {[&] { return std::move(render_s1_s2(mean, settings).s1); },
          [&] { return std::move(render_s1_s2(mean, settings).s2); },
          [&] { return render_dolp(dolp_of(mean), settings); },
          [&] { return render_aolp(aolp_deg_of(mean), dolp_of(mean), settings); }};
}

Json summary_json(const DolpSummary& dolp) {
  return {{"mean_dolp", dolp.mean ? Json(*dolp.mean) : Json()},
          {"undefined", dolp.undefined},
          {"aolp_undefined", dolp.aolp_undefined},
          {"dolp_above_one", dolp.above_one}};
}

std::string above_one_text(double share) {
  return share > 0 ? fmt::format(", above 1 (noise) {} %", percent_text(share)) : "";
}

// One value per cell, or one per pixel with --full.
StokesPicture stokes_picture(const StokesArguments& arguments, const RawFrame& frame,
                             const Progress& progress) {
  if (!arguments.full)
    return merge_greens(stokes_per_color(pack(frame.dn, frame.layout), frame.layout), frame.layout);
  const auto method =
      std::find(kDemosaickingNames.begin(), kDemosaickingNames.end(), arguments.method) -
      kDemosaickingNames.begin();
  return demosaick(frame.dn, frame.layout, static_cast<Demosaicking>(method), frame.source,
                   progress);
}

// What the noise of one input is: the model's, whose bias is taken out of the frame besides, or
// what denoise wrote beside it.
PixelErrors errors_of(const StokesArguments& arguments, const std::optional<NoiseModel>& model,
                      std::size_t index, FrameAsLight& light) {
  if (!model) return {load_variance(arguments.variance[index], light.frame)};
  PixelErrors errors = naming_model(arguments.model, [&] {
    return take_out_bias(light, *model, gain_range(arguments.extrapolate_gain),
                         arguments.fixed_pattern);
  });
  warn_of_model(*model, light.frame.gain, arguments.model, false);
  return errors;
}

void save_all(std::span<const fs::path> paths, const std::vector<Product>& products,
              const std::vector<std::string>& channels, const SaveOptions& options, Json& files) {
  for (std::size_t k = 0; k < products.size(); ++k) {
    save_picture(paths[k], products[k](), channels, options);
    files.push_back(paths[k].string());
  }
}

// shown: pictures of confidence, or none.
void save_pictures(StokesPicture picture, std::span<const Planes> shown,
                   const RenderSettings& settings, std::span<const fs::path> paths,
                   SaveOptions options, Json& files) {
  options.type = SampleType::kUint8;
  save_all(paths.first(1), {[&] { return render_s0(picture, settings); }}, {}, options, files);
  const StokesPlanes mean = mean_stokes(picture.planes);
  picture = {};  // several times the frame's size with --full
  std::vector<Product> pictures = mean_pictures(mean, settings);
  for (const Planes& planes : shown) pictures.push_back([&planes] { return planes; });
  save_all(paths.subspan(1), pictures, {}, options, files);
}

Json stokes_of_file(const StokesArguments& arguments, const std::optional<NoiseModel>& model,
                    std::size_t index, const FrameOptions& options, const ProductNames& names,
                    const Progress& progress, bool force) {
  const fs::path& input = arguments.inputs[index];
  if (arguments.confidence()) check_noise_source(input, options, model.has_value());
  FrameAsLight light =
      load_as_light(input, model ? options_for_model(options, *model, input) : options,
                    arguments.raw.float_black());
  const RawFrame& frame = light.frame;
  require_polarized(frame.layout, input.string());
  require_whole_cell(frame.dn, frame.layout, input.string());
  check_finite(frame.dn, frame.source, fate_in_polarization());
  warn_of_guesses(frame);
  PixelErrors errors;
  if (arguments.confidence()) errors = errors_of(arguments, model, index, light);
  const SaturatedCells saturated =
      arguments.confidence() ? saturated_cells(frame.dn, frame.layout, errors.variance)
                             : saturated_cells(frame.dn, frame.layout, light.saturated_dn);
  warn_of_saturation(frame, saturated);
  StokesPicture picture = stokes_picture(arguments, frame, progress);
  light.frame.dn = Image();
  warn_of_no_light(frame, picture.planes, arguments.full);
  const auto intensities = model ? Intensities::kMeasured : Intensities::kDenoised;
  Confidence confidence;
  if (arguments.confidence())
    confidence = confidence_of(
        uncertainty_of(picture, errors.variance, frame.layout, intensities, errors.offsets));
  std::vector<Product> data = product_data(picture);
  const std::vector<std::string> channels =
      picture.names.size() == 1 ? std::vector<std::string>{"Y"} : picture.names;
  Json json{{"input", input.string()},
            {"layout", frame.layout.name()},
            {"rows", picture.planes[0].s0.rows()},
            {"cols", picture.planes[0].s0.cols()},
            {"channels", channels},
            {"saturated_cells", saturated.count}};
  json.update(summary_json(summarize_dolp(data[3]())));
  if (arguments.confidence())
    for (const Planes& planes : confidence) data.push_back([&planes] { return planes; });
  SaveOptions save;
  save.force = force;
  for (const fs::path& path : names.stale) fs::remove(path);
  save_all(names.data, data, channels, save, json["files"]);
  if (!arguments.pictures) return json;
  Confidence shown;
  if (arguments.confidence())
    shown = confidence_pictures(
        uncertainty_of_mean(picture, errors.variance, frame.layout, intensities, errors.offsets),
        arguments.render);
  save_pictures(std::move(picture),
                arguments.confidence() ? std::span<const Planes>(shown) : std::span<const Planes>(),
                arguments.render, names.picture, save, json["files"]);
  return json;
}

std::string stokes_text(const Json& json, const fs::path& folder) {
  return fmt::format(
      "{}: {} x {} {}, mean DoLP {:.3f}, undefined {:.2f} %{}, AoLP undefined {:.2f} %, {} in {}\n",
      json["input"].get<std::string>(), json["cols"].get<int>(), json["rows"].get<int>(),
      json["layout"].get<std::string>(),
      json["mean_dolp"].is_null() ? std::nan("") : json["mean_dolp"].get<double>(),
      100 * json["undefined"].get<double>(), above_one_text(json["dolp_above_one"].get<double>()),
      100 * json["aolp_undefined"].get<double>(), counted(std::ssize(json["files"]), "file"),
      folder.string());
}

void check_usage(const StokesArguments& arguments) {
  if (arguments.confidence() && arguments.full)
    throw CLI::ValidationError("--full", "confidence is known per cell only: leave it out");
}

// A stack's frames are taken one by one.
void take_frames(StokesArguments& arguments, const FrameOptions& options) {
  arguments.inputs = frames_of_inputs(arguments.inputs, options);
  if (!arguments.variance.empty() && arguments.variance.size() != arguments.inputs.size())
    throw CLI::ValidationError("--variance", "one file per frame of RAW, in the same order");
}

void run_stokes(StokesArguments arguments, const Common& common) {
  check_usage(arguments);
  const FrameOptions options = arguments.raw.resolve();
  take_frames(arguments, options);
  std::optional<NoiseModel> model;
  if (!arguments.model.empty()) model = load_model(arguments.model);
  require_headers(arguments.inputs, options);
  const OutputFolder output(arguments.folder);
  const std::vector<ProductNames> plans = plan_product_files(arguments, common.force);
  const auto progress = make_progress(common);
  progress->begin("stokes", static_cast<std::int64_t>(arguments.inputs.size()));
  Json results = Json::array();
  std::string text;
  const auto work = [&] {
    for (std::size_t i = 0; i < arguments.inputs.size(); ++i) {
      check_stop(*progress);
      results.push_back(
          stokes_of_file(arguments, model, i, options, plans[i], *progress, common.force));
      text += stokes_text(results.back(), arguments.folder);
      progress->advance(1);
    }
  };
  work_and_print(work, [&] { print_frames(common, results, arguments.inputs.size(), text); });
}

}  // namespace

void add_stokes(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<StokesArguments>();
  CLI::App* command =
      add_command(app, common, "stokes", "S0, S1, S2, DoLP and AoLP of raw polarization frames",
                  {.force = true}, [arguments, &common] { run_stokes(*arguments, common); });
  command->add_option("RAW", arguments->inputs, "polarization mosaics")->required();
  command->add_option("-o,--output", arguments->folder, "folder of the results")->required();
  command->add_option("--format", arguments->format, "ending of the data files")
      ->check(one_of(product_formats()))
      ->capture_default_str();
  command->add_flag("!--no-pictures", arguments->pictures, "data files only");
  const std::string confidence =
      "Confidence: <stem>_s0_sd, _s1_sd, _s2_sd [DN], _dolp_sd, _aolp_sd [deg], _dolp_corrected";
  auto* model =
      command->add_option("--model", arguments->model,
                          "noise model of these raw frames; needs their gain. Its bias is "
                          "taken out of them");
  model->group(confidence);
  command
      ->add_flag("--extrapolate-gain", arguments->extrapolate_gain,
                 "allow a gain outside the calibrated range")
      ->needs(model)
      ->group(confidence);
  command
      ->add_flag("!--no-fixed-pattern", arguments->fixed_pattern,
                 "of frames that were flat-fielded: PRNU and DSNU are no part of their errors")
      ->needs(model)
      ->group(confidence);
  command
      ->add_option("--variance", arguments->variance,
                   "of denoised frames: what denoise --uncertainty wrote, one per RAW")
      ->excludes(model)
      ->group(confidence);
  auto* full = command->add_flag("--full", arguments->full,
                                 "one value per pixel by demosaicking, instead of one per cell");
  command->add_option("--demosaick", arguments->method, "how --full fills the gaps")
      ->needs(full)
      ->check(
          one_of(std::vector<std::string>(kDemosaickingNames.begin(), kDemosaickingNames.end())))
      ->capture_default_str();
  arguments->raw.add_to(*command, {.dark = true, .polarized = true});
  command->get_option("--dark")->excludes(model);
  add_flags(*command, arguments->render);
}

}  // namespace malus::app
