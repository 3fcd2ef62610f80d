// Bias and variance of every pixel of a raw frame as its noise profile tells them; from the
// variances the errors of polarization are propagated (polar/uncertainty.h).
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/noise/profile.h"

#include <cstdint>

namespace malus {

/// The least value of a saturated pixel of a frame above black; NaN where white is not known.
float saturation_dn(const RawFrame& above_black);

/// How many of the layout's cells have a saturated pixel, cells that the frame's edge cuts too: all
/// that is worked out of a whole cell, such as S0, DoLP and AoLP, is wrong there.
std::int64_t saturated_cells(const RawFrame& above_black);

/// NaN in the packed variance of the frame where its pixel is saturated, for there the noise tells
/// nothing of the error. Contract: the packed planes of that frame's size.
void forget_saturated(Planes& variance, const RawFrame& above_black);

/// Takes each channel's bias off a mosaic above black, saturated pixels too. Contract: the mosaic
/// is of the profile's layout.
void subtract_bias(Image& dn, const NoiseProfile& profile);

/// Takes the bias off a noisy frame above black, but for saturated pixels. Returns the variance of
/// every pixel [DN²]: the variance curve at the pixel itself, row noise added as if independent;
/// NaN for saturated pixels. Contract: the profile has the frame's layout.
Image take_out_bias(RawFrame& above_black, const NoiseProfile& profile);

}  // namespace malus
