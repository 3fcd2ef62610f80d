// Noise that was estimated from a picture, held against what its result leaves of the picture. Not
// installed.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/noise/profile.h"

#include <optional>

namespace malus::internal {

/// How much is looked at: the middle 512x512 pixels, or 256x256 of them, which tell only of a
/// result that is the picture itself.
enum class Look { kWhole, kGlance };

/// What the profile's variances have to be multiplied by, below 1, because the result of the
/// frame's middle contradicts them (docs/noise-estimate.md, "A second look"). Either it leaves
/// clearly less between itself and the picture than they say, equally so all over it: texture was
/// counted as noise. Or it states to keep nearly all of them, but a result with as much noise as it
/// took away does not: all of the picture was counted. None where nothing contradicts them, and
/// where noise was cut off at 0. Throws InputError as check_frame.
std::optional<double> share_that_result_shows(const RawFrame& frame, const NoiseProfile& profile,
                                              Look look = Look::kWhole);

/// What a variance multiplied by `share` lacks of that of rounding, which stays as it is.
double kept_rounding_dn2(const NoiseProfile& profile, double share);

/// The profile with the variances of all channels multiplied by `share`, but for that of rounding.
NoiseProfile with_scaled_variances(NoiseProfile profile, double share);

}  // namespace malus::internal
