// What the samples show together and the estimate lacks: points in the dark, scratches, faint
// marks. No residual of a single pixel tells it, the noise is larger; the mean of a few does.
#pragma once

#include "malus/denoise/internal/mosaic_filter.h"

#include <vector>

namespace malus::internal {

/// Adds to the expected squared error of `estimate` [noise variances] what neighbouring samples
/// of the frame (unit noise, whole up to `uncut`, one value per channel; nearer to white it is cut
/// off, and nothing is concluded) show that it lacks. A pixel depends on none further than two rows
/// or columns away.
void add_missed_signal(const FrameSource& frame, const std::vector<float>& uncut,
                       const Image& estimate, Image& error);

}  // namespace malus::internal
