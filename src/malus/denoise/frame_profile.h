// The noise of one frame that is to be denoised, from its camera's model: what denoise_frame takes.
// NoiseModel::profile_at is no substitute: it counts column noise as noise of pixels, as synthesis
// draws it, so the denoiser leaves the columns in; it has no fixed pattern; and its defects are the
// whole sensor's.
#pragma once

#include "malus/denoise/denoiser.h"
#include "malus/image/raw_frame.h"
#include "malus/noise/model.h"
#include "malus/noise/sensor_window.h"

#include <optional>
#include <string>

namespace malus {

struct FrameProfile {
  NoiseProfile profile;
  /// left_out_of_window (noise/sensor_window.h), to be told with the frame's name; empty where
  /// nothing is left out. What speaks against the model or the gain is in
  /// denoise/frame_complaints.h.
  std::string left_out;
  /// That the frame shows none of the pattern that the model has at a stated place, to be told
  /// likewise; empty where nothing speaks against it, or no place was stated.
  std::string unseen;
};

/// denoising_profile, with the fixed pattern and the defects that the settings ask for, cut to the
/// frame, and with what the pattern leaves in the frame as noise (pattern_deviations_at): all of it
/// where no maps fit the frame, and where it shows none of them though its place is stated; nothing
/// where a frame of the whole sensor shows clearly less than half of them; their sampling error
/// where they will be taken out. Nothing without settings.fixed_pattern. gain:
/// frame.gain, unless the caller knows better. place: of the frame's first pixel on the calibrated
/// sensor; none: maps and defects serve a frame of the sensor's whole size only. Throws InputError
/// as denoising_profile, whose subject is the model's or the gain's, and as cut_to_window, whose
/// subject is frame.source.
FrameProfile frame_profile(const RawFrame& frame, const NoiseModel& model, const GainSetting& gain,
                           const DenoiseSettings& settings = {},
                           std::optional<SensorPlace> place = std::nullopt,
                           GainRange range = GainRange::kCalibratedOnly);

/// denoising_profile of a raw frame that stays as it is, with the fixed pattern as noise of its
/// pixels: unless maps fit the frame and it shows clearly less than half of them, or the caller
/// knows better and does without fixed_pattern.
NoiseProfile raw_profile(const RawFrame& frame, const NoiseModel& model, const GainSetting& gain,
                         GainRange range = GainRange::kCalibratedOnly, bool fixed_pattern = true);

/// The model's profile, of a mean of frames what is left of it (noise/frame_mean.h), without what
/// it knows of single pixels' places: with column noise apart, unless the frame shows clearly less
/// than half of its deviation. Such a frame is of another state of the camera, or of synthesis,
/// which draws column noise as noise of pixels. Throws InputError as NoiseModel::profile_at and
/// require_levels (image/black_levels.h).
NoiseProfile denoising_profile(const RawFrame& frame, const NoiseModel& model,
                               const GainSetting& gain,
                               GainRange range = GainRange::kCalibratedOnly);

}  // namespace malus
