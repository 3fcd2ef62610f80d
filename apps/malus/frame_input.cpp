#include "frame_input.h"

#include "malus/base/error.h"
#include "malus/denoise/frame_profile.h"
#include "malus/image/pack.h"
#include "malus/noise/frame_levels.h"
#include "malus/noise/same_sensor.h"
#include "malus/synthesize/scene.h"

#include <cmath>
#include <utility>

#include "program.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

// What options and file tell of a frame, before anything is taken from a model.
RawFrame told_of(const std::filesystem::path& input, FrameOptions options) {
  const bool black_given = !options.black_dn.empty();
  // They may be one per channel of a layout that is not known yet.
  if (!options.layout && options.black_dn.size() > 1) options.black_dn.clear();
  RawFrame told = probe_frame(input, options).frame;
  told.black_known = told.black_known || black_given;
  return told;
}

// The file's own layout is never replaced by the model's: the model would describe other channels.
FrameOptions in_layout(FrameOptions options, const SensorLayout& model_layout,
                       const RawFrame& told) {
  if (told.layout_known)
    require_layout_of_model(told, model_layout);
  else
    options.layout = model_layout;
  return options;
}

}  // namespace

FrameOptions options_for_file(const std::filesystem::path& path, const FrameOptions& options,
                              FloatBlack float_black) {
  StatedLevels levels = levels_for_file(path, options, float_black);
  if (!levels.warning.empty()) warn_of(path.string(), levels.warning);
  return std::move(levels.options);
}

FrameAsLight load_as_light(const std::filesystem::path& path, const FrameOptions& options,
                           FloatBlack float_black) {
  FrameAsLight light{load_frame(path, options_for_file(path, options, float_black)), {}};
  light.saturated_dn = take_as_light(light.frame);
  return light;
}

RawFrame load_above_black(const std::filesystem::path& path, const FrameOptions& options,
                          FloatBlack float_black) {
  return load_as_light(path, options, float_black).frame;
}

void warn_of_untold_gain(const NoiseModel& model, const std::filesystem::path& file,
                         const std::vector<GainSetting>& asked) {
  if (const std::string line = untold_gain_complaint(model, asked); !line.empty())
    warn_of(file.string(), line);
}

FrameOptions options_in_layout(const FrameOptions& options, const SensorLayout& model_layout,
                               const std::filesystem::path& input) {
  return in_layout(options, model_layout, told_of(input, options));
}

FrameOptions options_for_model(const FrameOptions& options, const NoiseModel& model,
                               const std::filesystem::path& input) {
  const RawFrame told = told_of(input, options);
  FrameOptions result = in_layout(options, model.layout, told);
  RawFrame filled = told;
  const std::string warning = take_levels_of_model(model, filled, options.white_dn.has_value());
  if (!warning.empty()) warn_of(input.string(), warning);
  if (!told.black_known) result.black_dn = filled.black_dn;
  if (filled.white_known && (!told.white_known || filled.white_dn != told.white_dn))
    result.white_dn = filled.white_dn;
  return result;
}

NoiseProfile profile_for(const RawFrame& frame, const NoiseModel& model, GainRange range,
                         bool fixed_pattern) {
  try {
    return raw_profile(frame, model, frame.gain, range, fixed_pattern);
  } catch (const InputError& error) {
    throw InputError(frame.source + ": " + error.subject(), error.problem(), error.remedy());
  }
}

void check_finite(const Image& dn, const std::string& source, std::string_view what_comes) {
  if (const std::string complaint = nonfinite_complaint(dn, source, what_comes); !complaint.empty())
    warn(complaint);
}

Planes checked_light(const Picture& picture, const std::string& source, bool srgb) {
  const std::string complaint = nonfinite_light_complaint(
      nonfinite_light(picture.planes, picture.names), picture.planes[0].size(), source);
  if (!complaint.empty()) warn(complaint);
  return linear_light(picture.planes, picture.names, picture.white, srgb);
}

void warn_of_held_black(const std::filesystem::path& path, double mean_dn, double other_mean_dn,
                        double black_dn, std::string_view remedy) {
  // Noise averages out; another exposure rarely makes just this difference.
  constexpr double kAlike = 0.25;
  const double higher_dn = mean_dn - other_mean_dn;
  if (!(std::abs(higher_dn - black_dn) < kAlike * black_dn)) return;
  warn_of(path.string(),
          fmt::format("float pixels are taken as DN above black, but they lie {:.3g} DN higher on "
                      "average than the frame beside them; if they hold the camera's black level, "
                      "{:.4g} DN, {}",
                      higher_dn, black_dn, remedy));
}

Image above_black(const RawFrame& frame) {
  RawFrame copy = frame;
  subtract_black(copy);
  return std::move(copy.dn);
}

void warn_of_saturation(const RawFrame& frame, const SaturatedCells& cells) {
  if (const std::string complaint = cells.complaint(); !complaint.empty())
    warn(fmt::format("{}: {}", frame.source, complaint));
}

void warn_of_no_light(const RawFrame& frame, std::span<const StokesPlanes> planes, bool whole) {
  if (const std::string complaint = no_light_complaint(planes, whole); !complaint.empty())
    warn_of(frame.source, complaint);
}

void warn_of_guesses(const RawFrame& frame) {
  for (const std::string& complaint : guess_complaints(frame)) warn_of(frame.source, complaint);
}

void warn_of_unknown_black(const RawFrame& frame) {
  if (const std::string complaint = unknown_black_complaint(frame); !complaint.empty())
    warn_of(frame.source, complaint);
}

}  // namespace malus::app
