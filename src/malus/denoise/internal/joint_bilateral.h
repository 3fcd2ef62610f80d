// What a filter of blocks leaves noisy though its samples are alike: of print, bar codes and other
// things of a few levels no two blocks are the same, but nearly all pixels have a like one near by.
// So the samples are averaged once more, pixel by pixel, where the estimate says that they are
// alike: the joint bilateral filter (Petschnigg et al., "Digital photography with flash and
// no-flash image pairs", SIGGRAPH 2004) with the estimate for its guide. How much of the change is
// taken, the samples decide place by place by Stein's unbiased estimate of the squared error (Ann.
// Statist. 9, 1981): where light has many levels, as in photographs, it is next to nothing.
#pragma once

#include "malus/denoise/internal/mosaic_filter.h"

#include <vector>

namespace malus::internal {

/// Samples from `pixel`, whose noise has deviation 1 and is whole up to `uncut` (one value per
/// channel; nearer to white it is cut off), change `estimate`, which was made of them, and its
/// expected squared error, where there is one. Strips of the frame take what memory_mib leaves
/// after four bytes per `resident_values`; they and the threads do not change a byte of the result.
/// sure_noise: the variance that the noise has at least, 1 where it is known. Throws Cancelled.
void average_alike_pixels(const PixelSource& pixel, const std::vector<float>& uncut,
                          float sure_noise, const SensorLayout& layout, double memory_mib,
                          double resident_values, Image& estimate, Image* error,
                          Progress& progress);

}  // namespace malus::internal
