// Frames of row noise alone, or of a picture with it, for tests of what finds it.
#pragma once

#include "malus/base/random.h"
#include "malus/denoise/row_noise.h"

#include <cmath>
#include <vector>

namespace malus {

struct SimulatedRows {
  Image dn;
  std::vector<double> offset;
};

inline NoiseProfile profile_of_rows(double sigma_row_dn, double slope_dn) {
  NoiseProfile profile;
  profile.layout = SensorLayout::named("polar-bayer-rggb");
  profile.row_group = 2;
  for (int k = 0; k < 16; ++k) {
    ChannelProfile channel;
    channel.variance = VarianceCurve::affine(slope_dn, 14.0);
    channel.sigma_row_dn = sigma_row_dn * (k < 8 ? 1.0 : 1.1);
    profile.channels.push_back(channel);
  }
  return profile;
}

inline SimulatedRows simulate_rows(const NoiseProfile& profile, int rows, int cols, bool picture,
                                   std::uint64_t seed = 11, const RowDrift& drift = {}) {
  SimulatedRows result{Image(rows, cols), {}};
  RandomSequence draws(seed, 0, Draw::kRow), pixels(seed, 0, Draw::kPixel);
  const double keep = drift.white() ? 0 : std::exp(-1 / drift.length_groups);
  double slow = draws.normal();
  for (int g = 0; g < rows / profile.row_group; ++g) {
    if (g > 0) slow = keep * slow + std::sqrt(1 - keep * keep) * draws.normal();
    result.offset.push_back(drift.white() ? slow
                                          : std::sqrt(drift.share) * slow +
                                                std::sqrt(1 - drift.share) * draws.normal());
  }
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const auto& channel =
          profile.channels[static_cast<std::size_t>(profile.layout.channel_at(r, c))];
      const double clean =
          picture ? 60 + 40 * std::sin(0.11 * r + 0.05 * c) + (r > rows / 2 ? 50 : 0) : 30;
      result.dn(r, c) = static_cast<float>(
          clean + std::sqrt(channel.variance(clean)) * pixels.normal() +
          channel.sigma_row_dn * result.offset[static_cast<std::size_t>(r / profile.row_group)]);
    }
  return result;
}

inline const std::vector<float> kRowsSaturateDn(16, 4000.0f);

}  // namespace malus
