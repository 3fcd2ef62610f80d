// What a pixel sees of a picture behind its colour filter.
#pragma once

#include "malus/image/layout.h"

namespace malus {

/// plane(k): the light of red, green and blue, or of the one plane there is. Without a filter a
/// pixel sees all colours. Their mean: silicon has none of the eye's weights, and these are the
/// camera's colours, not sRGB's.
template <class Plane>
double light_behind_filter(Color filter, int planes, const Plane& plane) {
  if (planes < 3 || filter == Color::kRed) return plane(0);
  if (filter == Color::kMono) return (plane(0) + plane(1) + plane(2)) / 3;
  return plane(filter == Color::kBlue ? 2 : 1);
}

}  // namespace malus
