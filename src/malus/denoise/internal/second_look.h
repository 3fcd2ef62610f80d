// Noise that was estimated from a picture, held against what its result leaves of the picture. Not
// installed.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/noise/profile.h"

#include <optional>

namespace malus::internal {

/// What the profile's variances have to be multiplied by, below 1, for the result of the frame's
/// middle leaves clearly less between itself and the picture than they say, and equally so all over
/// it: texture was counted as noise (docs/noise-estimate.md, "A second look"). None where nothing
/// contradicts them, and where noise was cut off at 0. Throws InputError as check_frame.
std::optional<double> share_that_result_shows(const RawFrame& frame, const NoiseProfile& profile);

}  // namespace malus::internal
