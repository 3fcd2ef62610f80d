// Points of light that a filter takes for noise: smaller than its blocks and alone, they cost its
// transforms more coefficients than they are worth, however sure they are. A point of 26 deviations
// on one pixel kept a third of its light.
#pragma once

#include "malus/denoise/prepared_frame.h"

#include <vector>

namespace malus {

/// Puts back pixels of the frame that the noise does not explain, with the noise's own variance:
/// whatever they show, the result is wrong there by more. They lie more than five deviations
/// (stabilised; of the noise, or of the channel's residuals where those spread further) from the
/// result, or more than three while they stand out of all the result's around them by five; by more
/// than five where fewer than ten times what the profile's laws make lie so far, or chance makes as
/// many. Besides them all that stand out by twelve, where the filter took light from most of those,
/// or by five where a third are of the first kind too; and those that touch any of these and lie
/// more than three away. To the variance of pixels that lie three away and stay it adds what the
/// share of points among them makes probable.
/// Sets report.kept_pixels. Saturated pixels and filled ones, which measured nothing, stay.
void keep_points(const PreparedFrame& frame, const NoiseProfile& profile,
                 const std::vector<Stabilizer>& stabilizers, Denoised& report);

}  // namespace malus
