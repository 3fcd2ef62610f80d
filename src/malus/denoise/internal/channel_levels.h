// Where a frame's channels begin and end: what is subtracted before all else, and white above that.
#pragma once

#include "malus/denoise/saturated_pixels.h"
#include "malus/image/raw_frame.h"
#include "malus/noise/profile.h"

#include <algorithm>
#include <vector>

namespace malus::internal {

struct ChannelLevels {
  std::vector<float> zero_dn;       ///< black and bias
  std::vector<float> saturated_dn;  ///< white above them
  double highest_dn = 0;  ///< white above the lowest black: all that is not saturated is below
};

/// Where white is guessed (malus/image/raw_frame.h) a channel is saturated where its pixels
/// pile up; one without a pile nowhere: its limit lies another range above white.
inline ChannelLevels channel_levels(const RawFrame& frame, const NoiseProfile& profile) {
  ChannelLevels levels;
  levels.highest_dn =
      frame.white_dn - *std::min_element(frame.black_dn.begin(), frame.black_dn.end());
  const bool guessed = white_is_guessed(frame);
  const std::vector<float> piles_dn =
      guessed ? piled_up_dn(frame.dn, frame.layout) : std::vector<float>();
  for (std::size_t k = 0; k < frame.black_dn.size(); ++k) {
    levels.zero_dn.push_back(static_cast<float>(frame.black_dn[k] + profile.channels[k].bias_dn));
    double white_dn = frame.white_dn;
    if (guessed) white_dn = std::min(double{piles_dn[k]}, 2 * frame.white_dn - frame.black_dn[k]);
    // In single precision, as the pixels: those at white are found again.
    levels.saturated_dn.push_back(static_cast<float>(white_dn) - levels.zero_dn[k]);
  }
  return levels;
}

}  // namespace malus::internal
