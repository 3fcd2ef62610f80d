// Noise that stays because the filter returns the frame nearly as it was, as it does with texture
// that stands far above the noise. Weights that are made of the same samples let more of it through
// than their squares say (stated_error.h); what is left between frame and result tells.
#pragma once

#include "malus/denoise/internal/pixel_strip.h"

namespace malus::internal {

/// Lifts the expected squared error of `estimate` [noise variances] to what samples that are
/// returned carry. Where noise is cut off, or hidden by the converter's step, nothing is
/// concluded.
void state_returned_noise(const FrameSource& frame, const SampleNoise& noise, const Image& estimate,
                          Image& error);

}  // namespace malus::internal
