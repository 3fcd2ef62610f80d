// What is stated of the error of a network that corrects a classical result, its guide.
#pragma once

#include "malus/image/view.h"

namespace malus {

/// A correction takes away a part of the guide's error and is no larger than it, so that the
/// guide's stated variance holds for the result too (docs/uncertainty.md has how far). Where it is
/// larger
/// - light, texture or weights that training did not know -, the variance grows with it: times
/// squared correction over variance, both summed over 3x3 cells of 4x4 pixels, the nearer counting
/// more. Mosaics of one size [DN]; variance_dn2: the guide's, NaN where nothing is known.
void add_correction_error(View<const float> guide_dn, View<const float> result_dn,
                          View<float> variance_dn2);

}  // namespace malus
