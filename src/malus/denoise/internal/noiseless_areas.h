// Places of a frame that show no noise: a masked border, shadows that were crushed, an overlay.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"

#include <vector>

namespace malus {

/// Row by row of the frame, pixels of areas that hold one value and tell nothing of the noise;
/// empty where there are none. Areas: 8x8 pixels of a channel, or 64 in a row or column, which
/// noise of half a step makes equal once in ten billion times. Noise of less leaves such areas at
/// many values, and they tell of it: only a value counts that has four times the areas of all
/// others. saturated_dn: per channel, from where on pixels are known to be clipped; these are no
/// part of it. Empty too where little more than such areas would be left, so that a frame that is
/// black all over stays one.
std::vector<bool> noiseless_areas(View<const float> dn, const SensorLayout& layout,
                                  const std::vector<float>& saturated_dn);

}  // namespace malus
