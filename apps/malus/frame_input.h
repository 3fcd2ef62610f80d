// Frames as light: black subtracted, whatever the file holds.
#pragma once

#include "malus/base/error.h"
#include "malus/io/frame_file.h"
#include "malus/io/picture_file.h"
#include "malus/noise/model.h"
#include "malus/noise/raw_variance.h"
#include "malus/polar/stokes.h"

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raw_options.h"

namespace malus::app {

/// levels_for_file (frame_contents.h): what is not taken as stated is said on stderr.
FrameOptions options_for_file(const std::filesystem::path& path, const FrameOptions& options,
                              FloatBlack float_black);

/// A frame above black, and the least value of a saturated pixel of each of its channels
/// (saturation_dn, malus/noise/raw_variance.h).
struct FrameAsLight {
  RawFrame frame;
  std::vector<float> saturated_dn;
};

/// A raw frame minus its black level, see options_for_file. white_dn is above black.
FrameAsLight load_as_light(const std::filesystem::path& path, const FrameOptions& options,
                           FloatBlack float_black = FloatBlack::kAboveAlready);
/// The frame alone.
RawFrame load_above_black(const std::filesystem::path& path, const FrameOptions& options,
                          FloatBlack float_black = FloatBlack::kAboveAlready);

/// Says untold_gain_complaint (malus/noise/frame_levels.h) of the model in this file.
void warn_of_untold_gain(const NoiseModel& model, const std::filesystem::path& file,
                         const std::vector<GainSetting>& asked);

/// The options with the layout of a sensor where neither they nor the file tell one. Throws
/// InputError where they do and it is another.
FrameOptions options_in_layout(const FrameOptions& options, const SensorLayout& model_layout,
                               const std::filesystem::path& input);

/// The options for a frame of the model's sensor: layout, black and white come from the options,
/// else the file, else the model; float files that tell no black level hold DN above it, which is
/// said on stderr. Throws InputError where file and model have different layouts.
FrameOptions options_for_model(const FrameOptions& options, const NoiseModel& model,
                               const std::filesystem::path& input);

/// The noise at the frame's gain (of a model of one gain, at that one), with the fixed pattern's
/// part of it (raw_profile, malus/denoise/frame_profile.h) or without. Throws InputError, which
/// names the frame, where the model tells none there.
NoiseProfile profile_for(const RawFrame& frame, const NoiseModel& model, GainRange range,
                         bool fixed_pattern);

/// work(), whose InputError then names the model's file: a model does not know its own.
template <class Work>
auto naming_model(const std::filesystem::path& model, const Work& work) {
  try {
    return work();
  } catch (const InputError& error) {
    throw InputError(model.string() + ": " + error.subject(), error.problem(), error.remedy());
  }
}

/// Says nonfinite_complaint (frame_contents.h) on stderr.
void check_finite(const Image& dn, const std::string& source, std::string_view what_comes);

/// linear_light (malus/synthesize/scene.h) of a picture; says on stderr how many of its pixels hold
/// none. Throws InputError, which names `source`, where none holds any.
Planes checked_light(const Picture& picture, const std::string& source, bool srgb);

/// Says on stderr that a float file, which is taken as above black, lies above another frame of its
/// scene by about the black level, as if it held it. Means and black level in DN of one scale.
void warn_of_held_black(const std::filesystem::path& path, double mean_dn, double other_mean_dn,
                        double black_dn, std::string_view remedy);

/// A copy of the frame's pixels, black level taken off.
Image above_black(const RawFrame& frame);

/// Says on stderr how many cells of a frame hold saturated pixels, if any.
void warn_of_saturation(const RawFrame& frame, const SaturatedCells& cells);

/// Says on stderr that most cells of a frame, or most pixels (whole), have no light: its black
/// level is often the reason. planes: of every colour.
void warn_of_no_light(const RawFrame& frame, std::span<const StokesPlanes> planes, bool whole);

/// Says on stderr what a frame was taken for without anybody having stated it, layout, black and
/// white level, and where its pixels or its file contradict the layout.
void warn_of_guesses(const RawFrame& frame);
/// The part of it that matters to a comparison.
void warn_of_unknown_black(const RawFrame& frame);

}  // namespace malus::app
