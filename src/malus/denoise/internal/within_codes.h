// Where in a code the light of a frame lies, of a converter whose step hides the noise. The noise
// of rounded samples is next to none on a code and up to a quarter of step² between two, while a
// model tells the mean over all places. Pictures of many levels have that mean; even light, print
// and charts lie at few places, and the frame shows how much noise is there.
#pragma once

#include "malus/denoise/prepared_frame.h"
#include "malus/noise/profile.h"

namespace malus::internal {

/// The profile with more noise at signals of which the frame shows that they lie between two codes,
/// at most what rounding can make of the noise; nowhere less. A profile of noise that no step
/// hides, or that was estimated from the picture, comes back as it is.
NoiseProfile with_noise_between_codes(NoiseProfile profile, const PreparedFrame& frame);

}  // namespace malus::internal
