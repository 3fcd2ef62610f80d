// Bias and variance of every pixel of a raw frame as its noise profile tells them; from the
// variances the errors of polarization are propagated (polar/uncertainty.h).
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/noise/profile.h"

#include <cstdint>
#include <vector>

namespace malus {

/// Above black, the least value of a saturated pixel of every channel of a frame whose black is not
/// subtracted yet: white less the channel's own black. NaN where white is not known.
std::vector<float> saturation_dn(const RawFrame& frame);

/// How many of the layout's cells have a saturated pixel, cells that the frame's edge cuts too: all
/// that is worked out of a whole cell, such as S0, DoLP and AoLP, is wrong there. saturated_dn
/// (here and below): saturation_dn of the frame before its black was subtracted.
std::int64_t saturated_cells(const RawFrame& above_black, const std::vector<float>& saturated_dn);

/// NaN in the packed variance of the frame where its pixel is saturated, for there the noise tells
/// nothing of the error. Contract: the packed planes of that frame's size.
void forget_saturated(Planes& variance, const RawFrame& above_black,
                      const std::vector<float>& saturated_dn);

/// Takes each channel's bias off a mosaic above black, saturated pixels too. Contract: the mosaic
/// is of the profile's layout.
void subtract_bias(Image& dn, const NoiseProfile& profile);

/// Takes the bias off a noisy frame above black, but for saturated pixels. Returns the variance of
/// every pixel [DN²]: the variance curve at the pixel itself, row noise added as if independent;
/// NaN for saturated pixels. Contract: the profile has the frame's layout.
Image take_out_bias(RawFrame& above_black, const NoiseProfile& profile,
                    const std::vector<float>& saturated_dn);

}  // namespace malus
