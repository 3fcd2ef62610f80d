#include "malus/noise/frame_mean.h"

#include "malus/base/error.h"

#include <cmath>

namespace malus {

NoiseProfile mean_of_frames(NoiseProfile profile, int frames, MeanValues values) {
  MALUS_REQUIRE(frames >= 1);
  if (frames == 1) return profile;
  const double share = 1.0 / frames, deviations = std::sqrt(share);
  const bool rounded = values == MeanValues::kRounded;
  const double rounding_dn2 = rounded ? profile.step_dn * profile.step_dn / 12 : 0;
  for (ChannelProfile& channel : profile.channels) {
    MALUS_REQUIRE(!channel.variance.has_pattern());
    channel.variance = channel.variance.scaled(share).plus(rounding_dn2);
    if (channel.law) channel.law = channel.law->mean_of(frames, channel.variance);
    channel.guessed_dn2 *= share;
    channel.sigma_row_dn *= deviations;
    channel.sigma_column_dn *= deviations;
  }
  if (!rounded) profile.step_dn *= deviations;  // whose step^2 / 12 the variances hold
  profile.dark_was_cut_off = false;
  return profile;
}

}  // namespace malus
