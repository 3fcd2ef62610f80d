// What squared residuals tell of an error over a neighbourhood, where one pixel's tell nothing.
// Hardly any: the filter returns the frame nearly as it was, noise and all, as it does with texture
// that stands far above the noise; weights that are made of the same samples let more of it through
// than their squares say (stated_error.h). More than the noise: texture drowned in it.
#pragma once

#include "malus/denoise/internal/pixel_strip.h"

namespace malus::internal {

/// Lifts the expected squared error of `estimate` [noise variances] to what samples that are
/// returned carry, and adds what residuals have beyond the noise. Where noise is cut off, or hidden
/// by the converter's step, nothing is concluded.
void state_residual_evidence(const FrameSource& frame, const SampleNoise& noise,
                             const Image& estimate, Image& error);

}  // namespace malus::internal
