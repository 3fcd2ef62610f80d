// What a filter of blocks leaves noisy though its samples are alike: of print, bar codes and other
// things of a few levels no two blocks are the same, but nearly all pixels have a like one near by.
// So the samples are averaged once more, pixel by pixel, where the estimate says that they are
// alike: the joint bilateral filter (Petschnigg et al., "Digital photography with flash and
// no-flash image pairs", SIGGRAPH 2004) with the estimate for its guide. How much of the change is
// taken, the samples decide place by place by Stein's unbiased estimate of the squared error (Ann.
// Statist. 9, 1981): where light has many levels, as in photographs, it is next to nothing.
#pragma once

#include "malus/denoise/internal/memory_budget.h"
#include "malus/denoise/internal/pixel_strip.h"

namespace malus::internal {

/// What filters made of a frame.
struct FrameEstimate {
  Image& pixels;
  const Image& cell_error;  ///< its expected squared error, means over the cells
  Image* error = nullptr;   ///< the same of every pixel, where it is asked for
};

/// The frame's stabilised samples change the estimate that was made of them, and its error. Strips
/// take no more than the memory; they and threads do not change a byte of the result. Throws
/// Cancelled.
void average_alike_pixels(const FrameSource& frame, const SampleNoise& noise,
                          const MemoryBudget& memory, const FrameEstimate& estimate,
                          Progress& progress);

}  // namespace malus::internal
