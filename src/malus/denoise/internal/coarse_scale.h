// The frame at half the size, with half the noise: block matching and shrinkage see structures
// there that drown in the noise at full size, so its estimate has the better low frequencies. (Two
// scales of one denoiser, the coarse one trusted in the low frequencies only: Facciolo, Pierazzo,
// Morel, "Conservative scale recomposition for multiscale denoising", SIAM J. Imaging Sci. 10(3),
// 2017; here on mosaics, with means over 2x2 periods of the layout instead of the DCT.)
#pragma once

#include "malus/denoise/internal/mosaic_filter.h"

#include <optional>

namespace malus::internal {

/// Smallest frame with a coarse scale, in periods of the layout.
inline constexpr int kLeastCoarsePeriods = 16;
struct CoarseSize {
  int rows, cols;
};
/// Nothing for a frame that is too small to have one.
std::optional<CoarseSize> coarse_size(int rows, int cols, const SensorLayout& layout);

/// Twice the mean of the pixels of one channel in 2x2 neighbouring periods, so that unit noise
/// stays unit noise; a mosaic of the same layout, half as many periods per side, rounded down: one
/// that stood for a single period would have more noise than the others.
Image coarse_frame(const FrameSource& frame);

/// Replaces the low frequencies of `estimate` by those of its coarse frame's own estimate.
void correct_low_frequencies(Image& estimate, const Image& coarse_estimate,
                             const SensorLayout& layout);

}  // namespace malus::internal
