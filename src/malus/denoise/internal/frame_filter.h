// The default method's filter on a whole frame, tile by tile and scale by scale.
#pragma once

#include "malus/denoise/mosaic_filter.h"

namespace malus::internal {

/// Filters a frame whose noise has deviation 1 into `estimate`; `error`, when given, becomes the
/// expected squared error. Both have the frame's size when it is called. Tiles are cut so that they
/// and four bytes per `resident_values` take no more than memory_mib; they do not change a byte of
/// the result. Returns the number of tiles at full size. Throws InputError when the memory is too
/// little, Cancelled.
int filter_frame(const PixelSource& pixel, const SensorLayout& layout, const MosaicFilterPlan& plan,
                 double memory_mib, double resident_values, Image& estimate, Image* error,
                 Progress& progress);

}  // namespace malus::internal
