// Parts of a mosaic.
#pragma once

#include "malus/image/view.h"

namespace malus {

struct MosaicWindow {
  int row0 = 0, col0 = 0, rows = 0, cols = 0;
};

/// The view's values.
Image copy_of(View<const float> from);

/// A copy of these pixels. Contract: the window lies within the mosaic.
Image part_of(View<const float> mosaic, const MosaicWindow& window);

}  // namespace malus
