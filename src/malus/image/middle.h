// The middle of a mosaic, as experiments and validations cut it out.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"
#include "malus/image/window.h"

namespace malus {

/// Middle window of rows x cols pixels: of whole cells of the layout, of whole row groups and of
/// even size, at most `side` pixels a side; empty where the mosaic is smaller than that.
MosaicWindow middle_window(int rows, int cols, const SensorLayout& layout, int side,
                           int row_group = 1);

/// The pixels of middle_window without row groups.
Image middle_of(const Image& mosaic, const SensorLayout& layout, int side);

}  // namespace malus
