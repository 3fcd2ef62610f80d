// Bias and variance of every pixel of a raw frame as its noise profile tells them; from the
// variances the errors of polarization are propagated (polar/uncertainty.h).
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/image/shared_offsets.h"
#include "malus/noise/profile.h"

#include <cstdint>
#include <string>
#include <vector>

namespace malus {

/// Above black, the least value of a saturated pixel of every channel of a frame whose black is not
/// subtracted yet: white less the channel's own black. NaN where white is a guess.
std::vector<float> saturation_dn(const RawFrame& frame);

/// How many of the layout's cells have a saturated pixel, cells that the frame's edge cuts too: all
/// that is worked out of a whole cell, such as S0, DoLP and AoLP, is wrong there.
struct SaturatedCells {
  std::int64_t count = 0, of = 0;
  /// What to warn of, without the frame's name; empty where there are none.
  std::string complaint() const;
};

/// By the values of the pixels, of those that are numbers. saturated_dn (here and below):
/// saturation_dn of the frame before its black was subtracted.
SaturatedCells saturated_cells(View<const float> dn_above_black, const SensorLayout& layout,
                               const std::vector<float>& saturated_dn);

/// By the variance that is stated of them, which is NaN where a pixel is saturated: of denoised
/// frames this alone is sure, for their bright pixels lie about white. Pixels that are no numbers
/// have such a variance too and do not count. Contract: the packed planes of that mosaic's size.
SaturatedCells saturated_cells(View<const float> dn_above_black, const SensorLayout& layout,
                               const Planes& packed_variance);

/// Takes each channel's bias off a mosaic above black, saturated pixels too. Contract: the mosaic
/// is of the profile's layout.
void subtract_bias(Image& dn, const NoiseProfile& profile);
/// The highest bias of the channels, or 0: as much lower white lies where the bias is taken off.
/// Else what is saturated could not be told from what is nearly so.
double highest_bias_dn(const NoiseProfile& profile);

/// Takes the bias off a noisy frame above black, but for saturated pixels. Returns the variance of
/// every pixel [DN²]: the variance curve at the pixel itself (below no light carried on as its
/// mirror image, to half of its value there), its row noise and its column noise, which
/// shared_offsets tells the shared part of; NaN for saturated pixels. Contract: the profile has the
/// frame's layout.
Image take_out_bias(RawFrame& above_black, const NoiseProfile& profile,
                    const std::vector<float>& saturated_dn);

/// What the row and column noise of a frame's pixels has in common, up to the rows of a cell.
SharedOffsets shared_offsets(const NoiseProfile& profile);

}  // namespace malus
