// Frames whose dark places the camera cut off at its lowest code, 0: with a black level of no more
// than a few deviations of the noise, what noise takes below it is gone. Their mean is too high,
// and DoLP too low, until the noise's law is taken back (noise/clipped_noise.h).
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/noise/model.h"

#include <vector>

namespace malus {

/// Pixels at 0.
struct CutOff {
  std::vector<double> share;  ///< per channel: noise took them there; 0 where too few to tell
  /// Row by row of the frame, those in squares of them (4x4 of a channel), which show no noise:
  /// masked, or black by far. Empty where there are none.
  std::vector<bool> is_void;
  double mean_share() const;
  bool any() const { return mean_share() > 0; }
};

/// Of a frame as the camera wrote it. None in floats and signed codes.
CutOff measure_cut_off(const RawFrame& frame);

/// Of a mean of frames, which shows it no more: about which share of their pixels noise took to 0,
/// by the profile's noise of the mean. 0 of one frame, and where a pixel lies below 0: what ends
/// there is not the frames' codes.
double cut_off_share_of_mean(const RawFrame& frame, const NoiseProfile& of_mean);

/// A profile of dark frames that were cut off themselves, of which `model` measured what they
/// showed at this gain: with that variance of the dark, without rows and columns, in place of the
/// fitted law's, whose tails are those of no noise. Any other comes back as it is.
NoiseProfile with_shown_dark(NoiseProfile profile, const NoiseModel& model,
                             const GainSetting& gain);

/// A profile of dark frames that were cut off themselves (dark_was_cut_off): bias and variance as
/// they were before. Any other comes back as it is. frame: for its black levels.
NoiseProfile before_cut_off(NoiseProfile profile, const RawFrame& frame);

/// The profile of what the frame's pixels show: its channels that are cut off with the variance and
/// the law of clipped noise. Unchanged where a channel's noise is less than half a step: rounding
/// is what brings it to 0.
NoiseProfile as_shown(NoiseProfile profile, const RawFrame& frame, const CutOff& cut_off);

/// Whether as_shown has changed a channel's law: a denoiser that stabilises by it takes the cut
/// back.
bool has_cut_off_law(const NoiseProfile& shown);

/// A law of noise makes places that show none darker than no light: they are at 0.
void keep_voids(const CutOff& cut_off, Image& dn_above_black);

}  // namespace malus
