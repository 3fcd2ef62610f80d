// The middle of a mosaic, as experiments and validations cut it out.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"

namespace malus {

/// Middle window of whole cells of the layout and of even size, at most `side` pixels a side; empty
/// where the mosaic is smaller than that.
Image middle_of(const Image& mosaic, const SensorLayout& layout, int side);

}  // namespace malus
