#include "malus/denoise/internal/row_stripes.h"

#include "malus/base/random.h"

#include <cmath>
#include <cstdint>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

// The slow part of a share of the variance falls to 1/e over `length` groups; deviations of 0.1 are
// those of the estimate.
RowNoise drawn_offsets(std::size_t groups, std::uint32_t seed, double share = 0,
                       double length = 1) {
  RandomSequence draws(21, seed, Draw::kOther);
  RowNoise rows{{}, std::vector<double>(groups, 0.1)};
  const double keep = std::exp(-1 / length);
  double slow = draws.normal();
  for (std::size_t g = 0; g < groups; ++g) {
    slow = keep * slow + std::sqrt(1 - keep * keep) * draws.normal();
    rows.offset.push_back(std::sqrt(share) * slow + std::sqrt(1 - share) * draws.normal());
  }
  return rows;
}

double mean_square_difference(const std::vector<double>& a, const std::vector<double>& b,
                              std::size_t first, std::size_t last) {
  double sum = 0;
  for (std::size_t g = first; g < last; ++g) sum += (a[g] - b[g]) * (a[g] - b[g]);
  return sum / static_cast<double>(last - first);
}

double mean_square(const std::vector<double>& a, std::size_t first, std::size_t last) {
  return mean_square_difference(a, std::vector<double>(a.size()), first, last);
}

// 1.5 % of the frames are expected to change; more than 5 % would in 1 of 1000 sets of 200.
TEST(RowStripes, OffsetsThatACameraDrawsStay) {
  int changed = 0;
  for (std::uint32_t seed = 0; seed < 200; ++seed) {
    RowNoise rows = drawn_offsets(512, seed);
    const std::vector<double> before = rows.offset;
    leave_stripes_in(rows);
    changed += rows.offset != before;
  }
  EXPECT_LE(changed, 10);
}

// The measured drift of a camera (docs/calibration.md, "Rows of a real camera").
TEST(RowStripes, OffsetsThatDriftAsACamerasDoStayButForAFewHundredths) {
  double left = 0;
  for (std::uint32_t seed = 0; seed < 50; ++seed) {
    RowNoise rows = drawn_offsets(512, seed, 0.33, 2.0);
    const std::vector<double> before = rows.offset;
    leave_stripes_in(rows);
    left += mean_square_difference(rows.offset, before, 0, 512) / 50;
  }
  EXPECT_LT(left, 0.03);
}

// Of a camera that drifts by far more than any that was measured much is left; it is stated.
TEST(RowStripes, WhatIsLeftOfStrongDriftIsStated) {
  double left = 0, stated = 0;
  for (std::uint32_t seed = 0; seed < 50; ++seed) {
    RowNoise rows = drawn_offsets(512, seed, 0.6, 8.0);
    const std::vector<double> before = rows.offset;
    leave_stripes_in(rows);
    left += mean_square_difference(rows.offset, before, 0, 512) / 50;
    stated += mean_square(rows.deviation, 0, 512) / 50;
  }
  EXPECT_GT(left, 0.1);
  EXPECT_NEAR(stated / left, 1.2, 0.4);
}

// Of white offsets 1.5 % of the frames change; those of a drift that is known are as white.
TEST(RowStripes, StrongDriftThatIsKnownStays) {
  double left = 0;
  for (std::uint32_t seed = 0; seed < 50; ++seed) {
    RowNoise rows = drawn_offsets(512, seed, 0.6, 8.0);
    const std::vector<double> before = rows.offset;
    leave_stripes_in(rows, {0.6, 8.0});
    left += mean_square_difference(rows.offset, before, 0, 512) / 50;
  }
  EXPECT_LT(left, 0.01);
}

// Stripes hardly stronger than the camera's offsets, in 120 of 256 groups and in all.
TEST(RowStripes, StripesLeaveTheOffsets) {
  constexpr int kDraws = 20;
  for (const std::size_t first : {std::size_t{0}, std::size_t{136}})
    for (const std::size_t half_period : {std::size_t{2}, std::size_t{3}, std::size_t{8}}) {
      const auto stripe = [&](std::size_t g) { return (g / half_period) % 2 ? -1.2 : 1.2; };
      double taken = 0, error = 0, stated = 0, elsewhere = 0;
      for (std::uint32_t seed = 0; seed < kDraws; ++seed) {
        RowNoise rows = drawn_offsets(256, seed);
        const std::vector<double> camera = rows.offset;
        for (std::size_t g = first; g < 256; ++g) rows.offset[g] += stripe(g);
        leave_stripes_in(rows);
        for (std::size_t g = first; g < 256; ++g)
          taken += (rows.offset[g] - camera[g]) * stripe(g) / 1.2 /
                   static_cast<double>(256 - first) / kDraws;
        error += mean_square_difference(rows.offset, camera, first, 256) / kDraws;
        stated += mean_square(rows.deviation, first, 256) / kDraws;
        if (first > 0)
          elsewhere += mean_square_difference(rows.offset, camera, 0, first - 40) / kDraws;
      }
      EXPECT_LT(std::abs(taken), 0.3) << first << ", " << half_period;  // of 1.2
      EXPECT_LT(error, 0.6) << first << ", " << half_period;            // 1 if all were held back
      EXPECT_LT(error, stated) << first << ", " << half_period;
      EXPECT_LT(elsewhere, 0.1) << first << ", " << half_period;
    }
}

// Lines of all sizes without order, four times the model's deviation.
TEST(RowStripes, APartThatIsFarTooWideIsHeldBack) {
  RowNoise rows = drawn_offsets(400, 3);
  for (std::size_t g = 250; g < 400; ++g) rows.offset[g] *= 4;
  leave_stripes_in(rows);
  EXPECT_LT(mean_square(rows.offset, 280, 400), 0.3);
  for (std::size_t g = 280; g < 400; ++g) EXPECT_EQ(rows.deviation[g], 1);
  EXPECT_GT(mean_square(rows.offset, 0, 200), 0.6);
}

TEST(RowStripes, OffsetsOfAWarmerCameraAreNoStripes) {
  RowNoise rows = drawn_offsets(512, 5);
  for (double& offset : rows.offset) offset *= 1.6;
  const std::vector<double> before = rows.offset;
  leave_stripes_in(rows);
  EXPECT_LT(mean_square_difference(rows.offset, before, 0, 512),
            0.05 * mean_square(before, 0, 512));
}

TEST(RowStripes, FewGroupsStayAsTheyAre) {
  RowNoise rows = drawn_offsets(31, 1);
  for (std::size_t g = 0; g < 31; ++g) rows.offset[g] += g % 4 < 2 ? 5 : -5;
  const std::vector<double> before = rows.offset;
  leave_stripes_in(rows);
  EXPECT_EQ(rows.offset, before);
}

}  // namespace
}  // namespace malus
