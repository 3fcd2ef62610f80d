// How many pixels of a frame its noise throws far from their signal.
#pragma once

#include "malus/denoise/prepared_frame.h"

#include <span>
#include <vector>

namespace malus::internal {

/// Of the whole frame's pixels, how many lie beyond each threshold (in deviations of the noise):
/// by the normal law, or by that of the channel's read noise with shot noise added to it, whichever
/// has more.
std::vector<double> expected_beyond(const PreparedFrame& frame, const NoiseProfile& profile,
                                    std::span<const double> thresholds);

}  // namespace malus::internal
