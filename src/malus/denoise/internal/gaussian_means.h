// Local means that decide for a neighbourhood what one value's noise would decide badly.
#pragma once

#include "malus/image/view.h"

namespace malus::internal {

/// Means weighted by a Gaussian of this deviation, cut off beyond `radius` [both in values]; beyond
/// the edge there is nothing to count.
Image gaussian_means(const Image& from, float deviation, int radius);

}  // namespace malus::internal
