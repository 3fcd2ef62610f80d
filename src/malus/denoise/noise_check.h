// Whether a frame's own noise is that of the model it is denoised with: a wrong gain, another
// camera's model or a processed frame show in it.
#pragma once

#include <limits>
#include <optional>
#include <string>

namespace malus {

struct PreparedFrame;
struct NoiseProfile;

struct NoiseCheck {
  /// Deviation at the channels' mean signals, mean over the channels: as the frame shows it
  /// (estimate_noise.h; texture can only raise it), and as the profile says. frame_sd_dn is 0 where
  /// the frame is without noise, NaN where it cannot tell: too small, or of one value.
  double frame_sd_dn = 0, profile_sd_dn = 0;
  /// The profile's without the converter's rounding, over its step; infinite where that is unknown.
  double sd_in_steps = std::numeric_limits<double>::infinity();
  /// Share of what looks like the frame's noise that neighbouring pixels tell, as texture does
  /// (noise_floor.h); 1 of a single channel, where white texture could be anything.
  double texture_share = 0;
  /// Share of the pixels that lie further below the profile's dark level than noise reaches.
  double below_dark_share = 0;
};

/// Measured on up to a megapixel, in tiles from all over the frame. None where the profile is the
/// frame's own, and where the frame is too small or half of it is of one value, unless it lies
/// below the dark level.
std::optional<NoiseCheck> check_noise(const PreparedFrame& frame, const NoiseProfile& profile);

/// Of the profile's variance, the share that the frame surely has: less than 1 where the frame
/// shows less noise than the profile says. Print and codes, of which much looks like texture, may
/// show three quarters of the deviation all the same. 1 without a check.
double sure_noise_share(const std::optional<NoiseCheck>& check);

/// What the check says against the profile, in one sentence with the numbers; empty where
/// texture, chance or smoothing by rounding may explain the difference.
std::string noise_complaint(const NoiseCheck& check);

}  // namespace malus
