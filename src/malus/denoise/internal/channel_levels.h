// Where a frame's channels begin and end: what is subtracted before all else, and white above that.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/noise/profile.h"

#include <vector>

namespace malus::internal {

struct ChannelLevels {
  std::vector<float> zero_dn;       ///< black and bias
  std::vector<float> saturated_dn;  ///< white above them
};

inline ChannelLevels channel_levels(const RawFrame& frame, const NoiseProfile& profile) {
  ChannelLevels levels;
  for (std::size_t k = 0; k < frame.black_dn.size(); ++k) {
    levels.zero_dn.push_back(static_cast<float>(frame.black_dn[k] + profile.channels[k].bias_dn));
    // In single precision, as the pixels: those at white are found again.
    levels.saturated_dn.push_back(static_cast<float>(frame.white_dn) - levels.zero_dn[k]);
  }
  return levels;
}

}  // namespace malus::internal
