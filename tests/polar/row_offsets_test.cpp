// Row noise in the errors of Stokes parameters: pixels of a row group have one offset.
#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/image/pack.h"
#include "malus/polar/uncertainty.h"

#include <cmath>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr double kReadSd = 2, kLight = 50;

RowOffsets offsets_of(const SensorLayout& layout, double sd_dn, int group_rows) {
  return {std::vector<double>(static_cast<std::size_t>(layout.channels()), sd_dn), group_rows, {}};
}

// Even light with read noise and rows of the channels' deviations; correlation: of neighbouring
// groups, two apart its square.
Image noisy_frame(const SensorLayout& layout, const RowOffsets& rows, double correlation, int size,
                  std::uint32_t frame) {
  RandomSequence random(21, frame, Draw::kOther);
  Image dn(size, size);
  double offset = random.normal();
  for (int r = 0; r < size; ++r) {
    if (r > 0 && r % rows.group_rows == 0)
      offset = correlation * offset + std::sqrt(1 - correlation * correlation) * random.normal();
    for (int c = 0; c < size; ++c)
      dn(r, c) = static_cast<float>(
          kLight + kReadSd * random.normal() +
          offset * rows.sd_dn[static_cast<std::size_t>(layout.channel_at(r, c))]);
  }
  return dn;
}

Planes variance_with_rows(const SensorLayout& layout, const RowOffsets& rows, int size) {
  Image variance(size, size);
  for (int r = 0; r < size; ++r)
    for (int c = 0; c < size; ++c) {
      const double sd = rows.sd_dn[static_cast<std::size_t>(layout.channel_at(r, c))];
      variance(r, c) = static_cast<float>(kReadSd * kReadSd + sd * sd);
    }
  return pack(variance, layout);
}

struct Spread {
  Moments s0, s1, s2;
  double s0_stated = 0, s1_stated = 0, s2_stated = 0;
};

// Over the cell rows from `row` on, every `step`th, of many frames: of the mean of the colours, or
// of one.
Spread spread_of(const SensorLayout& layout, const RowOffsets& rows, double correlation, int color,
                 int row, int step) {
  constexpr int kFrames = 2000;
  const int size = 12 * layout.rows() / 2;
  Spread spread;
  const Planes variance = variance_with_rows(layout, rows, size);
  for (int k = 0; k < kFrames; ++k) {
    const Image dn = noisy_frame(layout, rows, correlation, size, static_cast<std::uint32_t>(k));
    const StokesPicture picture = merge_greens(stokes_per_color(pack(dn, layout), layout), layout);
    const StokesPlanes s =
        color < 0 ? mean_stokes(picture.planes) : picture.planes[static_cast<std::size_t>(color)];
    for (int r = row; r < s.s0.rows(); r += step) {
      spread.s0.add(s.s0(r, 1)), spread.s1.add(s.s1(r, 1)), spread.s2.add(s.s2(r, 1));
    }
    if (k > 0) continue;
    const auto stated =
        color < 0 ? uncertainty_of_mean(picture, variance, layout, Intensities::kMeasured, rows)
                  : uncertainty_of(picture, variance, layout, Intensities::kMeasured,
                                   rows)[static_cast<std::size_t>(color)];
    spread.s0_stated = stated.s0_variance(row, 1);
    spread.s1_stated = stated.s1_variance(row, 1);
    spread.s2_stated = stated.s2_variance(row, 1);
  }
  return spread;
}

// At least 4000 draws, of which half are as good as independent: 4 standard errors are 13 %.
constexpr double kTolerance = 0.13;

void expect_as_stated(const Spread& spread, const std::string& what) {
  EXPECT_NEAR(spread.s0.variance() / spread.s0_stated, 1, kTolerance) << what;
  EXPECT_NEAR(spread.s1.variance() / spread.s1_stated, 1, kTolerance) << what;
  EXPECT_NEAR(spread.s2.variance() / spread.s2_stated, 1, kTolerance) << what;
}

TEST(RowOffsets, AddUpInS0AndCancelInDifferences) {
  const auto layout = SensorLayout::named("polar-mono");
  // Two rows together: S0 = 2 x the offset, no row is left in S1 and S2. One by one: S0 has both
  // rows' offsets, S1 and S2 their difference.
  const auto one = spread_of(layout, offsets_of(layout, kReadSd, 1), 0, 0, 0, 1);
  const auto two = spread_of(layout, offsets_of(layout, kReadSd, 2), 0, 0, 0, 1);
  constexpr double v = kReadSd * kReadSd;
  EXPECT_FLOAT_EQ(static_cast<float>(one.s0_stated), static_cast<float>(3 * v));
  EXPECT_FLOAT_EQ(static_cast<float>(one.s1_stated), static_cast<float>(4 * v));
  EXPECT_FLOAT_EQ(static_cast<float>(two.s0_stated), static_cast<float>(5 * v));
  EXPECT_FLOAT_EQ(static_cast<float>(two.s2_stated), static_cast<float>(2 * v));
  expect_as_stated(one, "row by row");
  expect_as_stated(two, "two rows together");
}

// Groups of three rows meet cells of two in turn: within one, across two, within one.
TEST(RowOffsets, OfGroupsThatDivideCells) {
  const auto layout = SensorLayout::named("polar-mono");
  const RowOffsets rows = offsets_of(layout, kReadSd, 3);
  for (const int row : {0, 1, 2})
    expect_as_stated(spread_of(layout, rows, 0, 0, row, 3), fmt::format("cell row {}", row));
  EXPECT_GT(spread_of(layout, rows, 0, 0, 0, 3).s0_stated,
            1.5 * spread_of(layout, rows, 0, 0, 1, 3).s0_stated);
}

TEST(RowOffsets, OfColoursChannelsAndDriftingRows) {
  const auto layout = SensorLayout::named("polar-bayer-rggb");
  RowOffsets rows = offsets_of(layout, kReadSd, 1);
  for (int k = 0; k < 16; ++k) rows.sd_dn[static_cast<std::size_t>(k)] *= 0.5 + 0.1 * k;
  rows.correlation = {0.6, 0.36, 0.216};
  for (const int color : {-1, 0, 1, 2})
    expect_as_stated(spread_of(layout, rows, 0.6, color, 0, 1), fmt::format("colour {}", color));
}

}  // namespace
}  // namespace malus
