// The error that a converter's end makes beside saturated pixels: noise that would have gone above
// white is cut off there, so the samples' mean, which a filter finds, is darker than the light.
#pragma once

#include "malus/denoise/prepared_frame.h"

namespace malus {

/// How far the mean of min(x, white) lies below that of a Gaussian x which exceeds white with this
/// probability, in units of x's deviation. 0 < share < 1; grows without bound towards 1.
double censoring_bias(double share_above_white);

/// Adds its square to the variance [DN²] of pixels that have saturated ones of their channel around
/// them and are not darker than white by more than the noise reaches; all others stay the same.
/// estimate_dn and variance_dn2 have the frame's size.
void add_censoring_error(const PreparedFrame& frame, const NoiseProfile& profile,
                         View<const float> estimate_dn, Image& variance_dn2);

}  // namespace malus
