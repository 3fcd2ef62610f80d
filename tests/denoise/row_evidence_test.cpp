#include "malus/denoise/internal/row_evidence.h"

#include "malus/base/statistics.h"

#include <cmath>
#include <vector>

#include "denoise/simulated_rows.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr double kBiweightReach = 4.685;

// Tukey's biweight as it is written: four reweightings from the median of all pixels.
double plain_place(const Image& dn, const NoiseProfile& profile, int row, int distance) {
  std::vector<double> values, deviations;
  for (int c = 0; c < dn.cols(); ++c) {
    const ChannelProfile& channel =
        profile.channels[static_cast<std::size_t>(profile.layout.channel_at(row, c))];
    const double above = dn(row - distance, c), here = dn(row, c), below = dn(row + distance, c),
                 sigma = channel.sigma_row_dn;
    values.push_back((here - (above + below) / 2) / sigma);
    deviations.push_back(
        std::sqrt(1.5 * (channel.variance((above + here + below) / 3) + sigma * sigma)) / sigma);
  }
  double place = median_of(values);
  for (int pass = 0; pass < 4; ++pass) {
    double weighted = 0, weight = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double u = (values[i] - place) / (kBiweightReach * deviations[i]);
      if (std::abs(u) >= 1) continue;
      const double w = std::pow(1 - u * u, 2) / std::pow(deviations[i], 2);
      weighted += w * values[i];
      weight += w;
    }
    place = weighted / weight;
  }
  return place;
}

// Rows wide enough that the median is that of some of their pixels; a fifth of them are a picture's
// windows, whose light lies in single rows.
TEST(RowEvidence, IsTheBiweightOfAllPixels) {
  const NoiseProfile profile = profile_of_rows(1.0, 1.5);
  for (const bool windows : {false, true}) {
    SimulatedRows rows = simulate_rows(profile, 36, 3000, false);
    if (windows)
      for (int r = 0; r < 36; ++r)
        for (int c = 0; c < 3000; ++c)
          if (c % 50 < 10 && r % 8 < 4) rows.dn(r, c) += 80;
    for (int r = 4; r < 32; ++r) {
      const auto found = evidence_of_most(rows.dn, profile, kRowsSaturateDn, r, 1, kBiweightReach);
      ASSERT_TRUE(found);
      EXPECT_NEAR(found->value, plain_place(rows.dn, profile, r, 4),
                  0.02 * std::sqrt(found->variance))
          << r;
    }
  }
}

}  // namespace
}  // namespace malus
