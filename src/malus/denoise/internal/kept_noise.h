// How much of the noise an estimate keeps, told by what it leaves of its own samples and by the
// error that it states. Not installed.
#pragma once

#include "malus/denoise/internal/pixel_strip.h"

namespace malus::internal {

/// Covariance of the noise and the estimate, [noise variances], one value per cell, as far as the
/// samples tell it: below 0 and above 1 by chance. What 2x2 pixels have in common, their
/// mean, is counted by itself: the estimate keeps less noise of what they differ by, colour and
/// polarization, where these are simpler than the light.
struct KeptNoise {
  Image all, common;
  Image lack;  ///< of all pixels, what their squared residual lacks of the noise

  /// The same of a cell, 0..1.
  float of_all(int i, int k) const { return std::clamp(all(i, k), 0.0f, 1.0f); }
  float of_common(int i, int k) const { return std::clamp(common(i, k), 0.0f, 1.0f); }
  /// Of what the pixels differ by: of four pixels three differences.
  float of_unlike(int i, int k) const {
    return std::clamp((4 * all(i, k) - common(i, k)) / 3, 0.0f, 1.0f);
  }
};

/// Means over neighbourhoods of this radius, in cells.
inline constexpr int kNoiseRadius = 10;
KeptNoise measure_kept_noise(const PixelStrip& strip);

}  // namespace malus::internal
