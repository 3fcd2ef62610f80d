// What a filter of blocks leaves noisy though its samples are alike: of print, bar codes and other
// things of a few levels no two blocks are the same, but nearly all pixels have a like one near by.
// So the samples are averaged once more, pixel by pixel, where the estimate says that they are
// alike: the joint bilateral filter (Petschnigg et al., "Digital photography with flash and
// no-flash image pairs", SIGGRAPH 2004) with the estimate for its guide. How much of the change is
// taken, the samples decide place by place by Stein's unbiased estimate of the squared error (Ann.
// Statist. 9, 1981): where light has many levels, as in photographs, it is next to nothing.
#pragma once

#include "malus/denoise/internal/pixel_strip.h"

namespace malus::internal {

struct LikePixelSettings {
  double memory_mib, resident_values;  ///< strips take the first less four bytes of each value
  bool is_mix = false;                 ///< the estimate is a mean of two filters' (bm3d_mix.h)
};

/// Stabilised samples from `pixel` change `estimate`, which was made of them, and its expected
/// squared error, where there is one. Strips and threads do not change a byte of the result. Throws
/// Cancelled.
void average_alike_pixels(const PixelSource& pixel, const SampleNoise& noise,
                          const SensorLayout& layout, const LikePixelSettings& settings,
                          Image& estimate, Image* error, Progress& progress);

}  // namespace malus::internal
