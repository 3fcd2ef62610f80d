// Bias and variance of every pixel of a raw frame as its noise profile tells them; from the
// variances the errors of polarization are propagated (polar/uncertainty.h).
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/noise/profile.h"

namespace malus {

/// The least value of a saturated pixel of a frame above black; NaN where white is not known.
float saturation_dn(const RawFrame& above_black);

/// Takes each channel's bias off a mosaic above black, saturated pixels too. Contract: the mosaic
/// is of the profile's layout.
void subtract_bias(Image& dn, const NoiseProfile& profile);

/// Takes the bias off a noisy frame above black, but for saturated pixels. Returns the variance of
/// every pixel [DN²]: the variance curve at the pixel itself, row noise added as if independent;
/// NaN for saturated pixels. Contract: the profile has the frame's layout.
Image take_out_bias(RawFrame& above_black, const NoiseProfile& profile);

}  // namespace malus
