// How far a network may correct a classical result, its guide.
#pragma once

#include "malus/image/view.h"

namespace malus {

/// A correction takes away a part of the guide's error, so it is smaller than that. Where it is
/// larger than 0.3 of the variance that the guide states - light, texture or weights that training
/// did not know -, it is scaled down to that, and the guide's stated variance holds for the result.
/// Squared corrections and variances are summed over 3x3 cells of 4x4 pixels, the nearer counting
/// more; what it earns is in docs/networks.md. Mosaics of one size [DN]; variance_dn2: the guide's,
/// NaN where nothing is known, and there the correction stays.
void limit_correction(View<const float> guide_dn, View<const float> variance_dn2,
                      View<float> result_dn);

}  // namespace malus
