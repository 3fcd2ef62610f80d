// How near a picture is to its reference. Pixels that are not finite in either picture are left
// out of every metric. Nothing is clipped unless said.
#pragma once

#include "malus/base/estimate.h"
#include "malus/image/view.h"

#include <cstdint>

namespace malus {

/// Mean of (a - b)² over the pixels that are finite in both. Sizes equal.
struct SquaredError {
  double sum = 0;
  std::int64_t count = 0;
  double mean() const { return sum / static_cast<double>(count); }
};
SquaredError squared_error(View<const float> a, View<const float> b);

/// Peak signal-to-noise ratio 10 log10(peak² / mean squared error) in dB; infinite where the
/// pictures are equal. Undecided without a single finite pair.
Estimate<double> psnr_db(const SquaredError& error, double peak);
/// Over all channels together (000 Table 1: 16 of a packed mosaic).
Estimate<double> psnr_db(const Planes& reference, const Planes& test, double peak);

/// Structural similarity: Wang, Bovik, Sheikh, Simoncelli, IEEE TIP 13(4), 2004, Eq. 13 with their
/// settings: Gaussian window 11x11, σ = 1.5, K1 = 0.01, K2 = 0.03, no downsampling; the mean over
/// the windows that lie inside the picture. Windows that touch a pixel that is not finite are left
/// out. Undecided below 11x11 pixels or without a whole window.
Estimate<double> ssim(View<const float> reference, View<const float> test, double peak);
/// Mean over the channels.
Estimate<double> ssim(const Planes& reference, const Planes& test, double peak);

}  // namespace malus
