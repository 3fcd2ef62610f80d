// malus normals: shape from polarization.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/image/pack.h"
#include "malus/io/picture_file.h"
#include "malus/polar/demosaick.h"
#include "malus/polar/normals.h"
#include "malus/polar/render.h"
#include "malus/polar/stokes.h"

#include <algorithm>
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

struct NormalsArguments {
  RawOptions raw;
  NormalSettings settings;
  std::vector<fs::path> inputs;
  fs::path folder, mask, reference;
  bool full = false;
};

void require_size(const fs::path& path, const Planes& planes, int channels, const Image& like) {
  if (planes.channels() == channels && planes.rows() == like.rows() && planes.cols() == like.cols())
    return;
  throw InputError(path.string(),
                   fmt::format("{} x {} pixels, {} against {} x {}, {}", planes.cols(),
                               planes.rows(), counted(planes.channels(), "channel"), like.cols(),
                               like.rows(), counted(channels, "channel")),
                   "it has to match the normals: one pixel per cell, or per pixel with --full");
}

// 1 where any colour is above 0 and alpha does not hide it; where no colour is, alpha is the mask.
Image load_mask(const fs::path& path, const Image& s0) {
  const Picture picture = load_picture(path);
  const int channels = picture.planes.channels();
  require_size(path, picture.planes, channels, s0);
  const auto alpha = alpha_plane(path, picture);
  const auto is_object = [](float v) { return v > 0; };
  Image mask(s0.rows(), s0.cols());
  for (int k = 0; k < channels; ++k) {
    if (alpha && static_cast<std::size_t>(k) == *alpha) continue;
    for (std::size_t i = 0; i < mask.size(); ++i)
      if (is_object(picture.planes[k].values()[i])) mask.values()[i] = 1.0f;
  }
  if (alpha) {
    const std::vector<float>& coverage = picture.planes[static_cast<int>(*alpha)].values();
    const bool drawn = std::ranges::any_of(mask.values(), is_object);
    for (std::size_t i = 0; i < mask.size(); ++i)
      mask.values()[i] =
          (!drawn || is_object(mask.values()[i])) && is_object(coverage[i]) ? 1.0f : 0.0f;
  }
  if (std::ranges::none_of(mask.values(), is_object))
    throw InputError(path.string(), "no pixel is above 0 and seen, so that nothing is the object",
                     "give a picture that is above 0 where the object is");
  return mask;
}

// Maps that were resized or kept as halves have lengths a little off, at outlines more.
constexpr double kLengthTolerance = 0.05, kLeastUnit = 0.5;

NormalMap load_normals(const fs::path& path, const Image& like) {
  const char* const remedy =
      "give X, Y, Z from -1 to 1 as floats, such as the _normals.exr that malus normals writes";
  Picture picture = load_picture(path);
  Planes& planes = picture.planes;
  require_size(path, planes, 3, like);
  if (picture.bits > 0)
    throw InputError(path.string(), "holds integers: a picture of normals, not normals", remedy);
  NormalMap normals{std::move(planes[0]), std::move(planes[1]), std::move(planes[2])};
  std::size_t count = 0, unit = 0;
  for (std::size_t i = 0; i < normals.x.size(); ++i) {
    if (!has_normal(normals, i)) continue;
    ++count;
    const double length =
        std::hypot(normals.x.values()[i], normals.y.values()[i], normals.z.values()[i]);
    unit += std::abs(length - 1) < kLengthTolerance;
  }
  if (count == 0)
    throw InputError(path.string(), "has no normal: every pixel is (0, 0, 0) or not finite",
                     remedy);
  if (static_cast<double>(unit) < kLeastUnit * static_cast<double>(count))
    throw InputError(path.string(), "its vectors are no normals: most have another length than 1",
                     remedy);
  return normals;
}

Planes planes_of(const NormalMap& normals) {
  Planes planes(3, 0, 0);
  planes[0] = normals.x;
  planes[1] = normals.y;
  planes[2] = normals.z;
  return planes;
}

Json normals_of_file(const NormalsArguments& arguments, const fs::path& input,
                     const FrameOptions& options, const fs::path& data, const fs::path& picture,
                     const Progress& progress, bool force) {
  const FrameAsLight light = load_as_light(input, options, arguments.raw.float_black());
  const RawFrame& frame = light.frame;
  require_polarized(frame.layout, input.string());
  require_whole_cell(frame.dn, frame.layout, input.string());
  check_finite(frame.dn, frame.source, fate_in_polarization());
  warn_of_guesses(frame);
  const SaturatedCells saturated = saturated_cells(frame.dn, frame.layout, light.saturated_dn);
  warn_of_saturation(frame, saturated);
  // Stokes vectors of all colours together: the mean of R, G and B.
  const StokesPicture colors =
      arguments.full
          ? demosaick(frame.dn, frame.layout, Demosaicking::kResidual, frame.source, progress)
          : merge_greens(stokes_per_color(pack(frame.dn, frame.layout), frame.layout),
                         frame.layout);
  const StokesPlanes stokes = mean_stokes(colors.planes);
  warn_of_no_light(frame, {&stokes, 1}, arguments.full);
  const Image mask = arguments.mask.empty()
                         ? foreground_mask(stokes.s0, arguments.settings.foreground)
                         : load_mask(arguments.mask, stokes.s0);
  const NormalMap normals = normals_of(stokes, mask, arguments.settings);
  Json json{{"input", input.string()},
            {"rows", stokes.s0.rows()},
            {"cols", stokes.s0.cols()},
            {"saturated_cells", saturated.count},
            {"object_pixels", std::count_if(mask.values().begin(), mask.values().end(),
                                            [](float v) { return v > 0; })}};
  if (!arguments.reference.empty()) {
    const auto error =
        mean_angular_error_deg(normals, load_normals(arguments.reference, stokes.s0));
    if (!error) throw InputError(arguments.reference.string(), error.reason(), "check the mask");
    json["mean_angular_error_deg"] = *error;
  }
  SaveOptions save;
  save.force = force;
  save_picture(data, planes_of(normals), {"X", "Y", "Z"}, save);
  save.type = SampleType::kUint8;
  save_picture(picture, render_normals(normals), {}, save);
  json["files"] = {data.string(), picture.string()};
  return json;
}

std::string normals_text(const Json& json) {
  std::string text = fmt::format("{}: {} x {} normals, {} object pixels",
                                 json["input"].get<std::string>(), json["cols"].get<int>(),
                                 json["rows"].get<int>(), json["object_pixels"].get<long>());
  if (json.contains("mean_angular_error_deg"))
    text += fmt::format(", mean angular error {:.2f} degrees",
                        json["mean_angular_error_deg"].get<double>());
  return text + '\n';
}

std::string conventions_text(const NormalSettings& settings) {
  const bool specular = settings.reflection == "specular";
  return fmt::format(
      "{} reflection, refractive index {:g}; of the two opposite azimuths {} is taken{} (--model, "
      "--index, --azimuth{})",
      settings.reflection, settings.index,
      settings.azimuth == "convex" ? "the one away from the object's centre"
                                   : "the one pointing " + settings.azimuth,
      !specular                 ? ""
      : settings.above_brewster ? ", of the two zeniths the one above Brewster's angle"
                                : ", of the two zeniths the one below Brewster's angle",
      specular ? ", --above-brewster" : "");
}

void check_usage(const NormalSettings& settings) {
  if (settings.above_brewster && settings.reflection != "specular")
    throw CLI::ValidationError("--above-brewster", "a " + settings.reflection +
                                                       " DoLP has one zenith: leave it out, or "
                                                       "give --model specular");
}

void run_normals(NormalsArguments arguments, const Common& common) {
  check_usage(arguments.settings);
  const FrameOptions options = arguments.raw.resolve();
  arguments.inputs = frames_of_inputs(arguments.inputs, options);
  require_headers(arguments.inputs, options);
  const OutputFolder output(arguments.folder);
  std::vector<fs::path> besides = arguments.raw.files_read();
  besides.insert(besides.end(), {arguments.mask, arguments.reference});
  const auto data = output_names(arguments.inputs, arguments.folder, "_normals.exr", besides);
  const auto pictures = output_names(arguments.inputs, arguments.folder, "_normals.png", besides);
  for (const auto& list : {data, pictures})
    for (const auto& path : list) check_output(path, common.force);
  const auto progress = make_progress(common);
  progress->begin("normals", static_cast<std::int64_t>(arguments.inputs.size()));
  Json results = Json::array();
  std::string text;
  const auto work = [&] {
    for (std::size_t i = 0; i < arguments.inputs.size(); ++i) {
      check_stop(*progress);
      results.push_back(normals_of_file(arguments, arguments.inputs[i], options, data[i],
                                        pictures[i], *progress, common.force));
      if (i == 0) progress->note(conventions_text(arguments.settings));  // an error stands alone
      text += normals_text(results.back());
      progress->advance(1);
    }
  };
  work_and_print(work, [&] { print_frames(common, results, arguments.inputs.size(), text); });
}

}  // namespace

void add_normals(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<NormalsArguments>();
  CLI::App* command =
      add_command(app, common, "normals", "Surface normals from raw polarization frames",
                  {.force = true}, [arguments, &common] { run_normals(*arguments, common); });
  command->add_option("RAW", arguments->inputs, "polarization mosaics")->required();
  command->add_option("-o,--output", arguments->folder, "folder of the results")->required();
  command->add_option(
      "--mask", arguments->mask,
      "picture whose pixels above 0 in any colour (without colour: in alpha) are the "
      "object; else bright pixels are");
  command->add_option(
      "--reference", arguments->reference,
      "normals (X, Y, Z) to measure the mean angular error against; (0, 0, 0) or NaN "
      "where it has none");
  command->add_flag("--full", arguments->full,
                    "one normal per pixel by demosaicking, instead of one per cell");
  arguments->raw.add_to(*command, {.dark = true, .polarized = true});
  add_flags(*command, arguments->settings);
  command->get_option("--foreground")->excludes("--mask");  // which says the same
}

}  // namespace malus::app
