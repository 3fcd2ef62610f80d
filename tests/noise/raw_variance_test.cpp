// The variance of raw pixels from a profile whose numbers are known.
#include "malus/noise/raw_variance.h"

#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <random>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr double kSlope = 0.5, kOffset = 9, kBias = 3, kRow = 2, kWhite = 1000;

RawFrame ramp(bool white_known) {
  RawFrame frame;
  frame.layout = SensorLayout::named("polar-mono");
  frame.black_dn.assign(4, 0.0);
  frame.white_dn = kWhite;
  frame.white_known = white_known;
  frame.dn = Image(2, 4);
  const float values[] = {-5, 0, 3, 103, 999, 1000, 1200, NAN};
  std::copy(std::begin(values), std::end(values), frame.dn.values().begin());
  return frame;
}

NoiseProfile profile() {
  NoiseProfile profile;
  profile.layout = SensorLayout::named("polar-mono");
  profile.channels.assign(4, ChannelProfile{.variance = VarianceCurve::affine(kSlope, kOffset),
                                            .bias_dn = kBias,
                                            .sigma_row_dn = kRow});
  return profile;
}

TEST(RawVariance, IsTheCurveAtThePixelWithItsRow) {
  RawFrame frame = ramp(true);
  const Image variance = take_out_bias(frame, profile(), saturation_dn(frame));
  EXPECT_FLOAT_EQ(variance(0, 0), kOffset - kSlope * 8 + kRow * kRow);  // below no light: less
  EXPECT_FLOAT_EQ(frame.dn(0, 0), -5 - kBias);
  EXPECT_FLOAT_EQ(variance(0, 3), kSlope * 100 + kOffset + kRow * kRow);
  EXPECT_FLOAT_EQ(frame.dn(0, 3), 100);
  EXPECT_FLOAT_EQ(variance(1, 0), kSlope * 996 + kOffset + kRow * kRow);
  EXPECT_TRUE(std::isnan(variance(1, 3)));
}

// Poisson light and read noise of 2.4 electrons, 0.5 DN/e-. With the variance of no light for all
// pixels below it the mean was 17 % too large in the dark.
TEST(RawVariance, MeansTheTrueOneInTheDark) {
  constexpr double kReadElectrons = 2.4, kRead2 = kReadElectrons * kReadElectrons;
  NoiseProfile dark = profile();
  for (ChannelProfile& channel : dark.channels)
    channel = {.variance = VarianceCurve::affine(kSlope, kSlope * kSlope * kRead2)};
  for (const double of_read_noise : {0.0, 0.3, 1.0, 3.0, 10.0}) {
    const double electrons = of_read_noise * kReadElectrons;
    RawFrame frame = ramp(true);
    frame.dn = Image(300, 300);
    std::mt19937 random(5);
    std::poisson_distribution<int> light(std::max(electrons, 1e-9));
    std::normal_distribution<double> read(0, kReadElectrons);
    for (float& pixel : frame.dn.values())
      pixel = static_cast<float>(kSlope * (light(random) + read(random)));
    Moments stated;
    const Image variance = take_out_bias(frame, dark, saturation_dn(frame));
    for (const float v : variance.values()) stated.add(v);
    const double truth = kSlope * kSlope * (electrons + kRead2);
    EXPECT_NEAR(stated.mean() / truth, 1.01, 0.02) << of_read_noise;  // 2.5 % too much at 0
    EXPECT_GE(*std::ranges::min_element(variance.values()), 0.49 * kSlope * kSlope * kRead2);
  }
}

TEST(RawVariance, OfSaturatedPixelsIsNotKnownAndTheyStay) {
  RawFrame frame = ramp(true);
  const Image variance = take_out_bias(frame, profile(), saturation_dn(frame));
  for (const int col : {1, 2}) EXPECT_TRUE(std::isnan(variance(1, col)));
  EXPECT_EQ(frame.dn(1, 1), 1000);
  EXPECT_EQ(frame.dn(1, 2), 1200);
  RawFrame unknown = ramp(false);
  EXPECT_FLOAT_EQ(take_out_bias(unknown, profile(), saturation_dn(unknown))(1, 1),
                  kSlope * 997 + kOffset + kRow * kRow);
}

TEST(RawVariance, RowsAndColumnsShareTheirOffsets) {
  NoiseProfile drifting = profile();
  drifting.channels[1].sigma_column_dn = 4;
  drifting.channels[2].sigma_row_dn = 5;
  drifting.row_group = 2;
  EXPECT_TRUE(shared_offsets(drifting).rows.correlation.empty());
  drifting.row_drift = {0.5, 2};
  const auto [rows, columns] = shared_offsets(drifting);
  EXPECT_EQ(rows.sd_dn, (std::vector<double>{kRow, kRow, 5, kRow}));
  EXPECT_EQ(rows.group_lines, 2);
  ASSERT_EQ(rows.correlation.size(), 1u);  // a cell has two rows
  EXPECT_DOUBLE_EQ(rows.correlation[0], 0.5 * std::exp(-0.5));
  EXPECT_EQ(columns.sd_dn, (std::vector<double>{0, 4, 0, 0}));
  EXPECT_EQ(columns.group_lines, 1);
  RawFrame frame = ramp(true);
  EXPECT_FLOAT_EQ(take_out_bias(frame, drifting, saturation_dn(frame))(0, 3),
                  kSlope * 100 + kOffset + kRow * kRow + 4 * 4);
}

TEST(RawVariance, BiasIsEachChannelsOwn) {
  NoiseProfile uneven = profile();
  for (std::size_t k = 0; k < 4; ++k) uneven.channels[k].bias_dn = static_cast<double>(k);
  Image dn(4, 4);
  subtract_bias(dn, uneven);
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) EXPECT_EQ(dn(r, c), -(2 * (r % 2) + c % 2));
}

// Two cells of 2x2 pixels; white is 1000 DN.
TEST(Saturation, IsCountedByCell) {
  RawFrame frame = ramp(true);
  EXPECT_EQ(saturated_cells(frame.dn, frame.layout, saturation_dn(frame)).count, 2);
  frame.dn(1, 1) = 999;
  const SaturatedCells cells = saturated_cells(frame.dn, frame.layout, saturation_dn(frame));
  EXPECT_EQ(cells.count, 1);
  EXPECT_EQ(cells.of, 2);
  EXPECT_EQ(cells.complaint(),
            "1 cell (50 %) with saturated pixels: S0, DoLP and AoLP are wrong there");
  RawFrame unknown = ramp(false);
  EXPECT_EQ(saturated_cells(unknown.dn, unknown.layout, saturation_dn(unknown)).count, 0);
  EXPECT_EQ(SaturatedCells({0, 2}).complaint(), "");
}

// Whatever the values: those of denoised pixels lie about white. A pixel that is no number has no
// variance either.
TEST(Saturation, IsCountedByTheVarianceThatIsStated) {
  RawFrame frame = ramp(true);
  Planes variance(4, 1, 2);
  for (Image& plane : variance)
    for (float& v : plane.values()) v = 7;
  variance[3](0, 1) = NAN;  // beside NAN
  EXPECT_EQ(saturated_cells(frame.dn, frame.layout, variance).count, 0);
  variance[1](0, 0) = NAN;  // beside 0
  variance[0](0, 0) = NAN;
  EXPECT_EQ(saturated_cells(frame.dn, frame.layout, variance).count, 1);
}

// Black levels of 60, 70, 50 and 60 DN below one white: a pixel just under the highest of these
// limits is whole in one channel and saturated in another.
TEST(Saturation, IsWhiteLessTheChannelsOwnBlack) {
  RawFrame frame;
  frame.layout = SensorLayout::named("polar-mono");
  frame.black_dn = {60, 70, 50, 60};
  frame.white_dn = 1000;
  frame.white_known = true;
  frame.dn = Image(2, 4, 999.0f);
  frame.dn(0, 2) = frame.dn(1, 3) = 1000;
  const std::vector<float> limits_dn = saturation_dn(frame);
  subtract_black(frame);
  EXPECT_EQ(saturated_cells(frame.dn, frame.layout, limits_dn).count, 1);
  const Image taken = take_out_bias(frame, profile(), limits_dn);
  for (int r = 0; r < 2; ++r)
    for (int c = 0; c < 4; ++c) {
      const bool at_white = (r == 0 && c == 2) || (r == 1 && c == 3);
      EXPECT_EQ(std::isnan(taken(r, c)), at_white) << r << c;
    }
}

TEST(Saturation, PixelsThatAreNoNumbersAreNotSaturated) {
  const SensorLayout layout = SensorLayout::named("polar-mono");
  Image dn(2, 4, 500.0f);
  dn(0, 0) = std::numeric_limits<float>::infinity();
  dn(0, 2) = 1000;
  EXPECT_EQ(saturated_cells(dn, layout, std::vector<float>(4, 900.0f)).count, 1);
  Planes variance(4, 1, 2);
  variance[0](0, 0) = variance[0](0, 1) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(saturated_cells(dn, layout, variance).count, 1);
}

}  // namespace
}  // namespace malus
