// A channel's noise between its levels, above them and on other bins.
#include "malus/noise/level_noise.h"

#include "malus/noise/internal/table_at.h"
#include "malus/noise/model.h"

#include <cmath>
#include <limits>
#include <numeric>

#include "sample_model.h"
#include "support.h"

namespace malus {
namespace {

// Uniform noise of ±1 DN in the dark, of ±4 DN at 100.
NonparametricChannel two_levels() {
  NonparametricChannel channel;
  channel.level_dn = {0, 100};
  channel.bin_edges_dn = {-4, -1, 1, 4};
  channel.pmf = {{0, 1, 0}, {3.0 / 8, 2.0 / 8, 3.0 / 8}};
  channel.samples = {1000, 1000};
  return channel;
}

// Of two values at one x the first counts.
TEST(TableAt, IsExactAtItsKnots) {
  const std::vector<double> x{0.1, 0.3, 0.3, 0.7}, y{0.1, 0.7, 1.1, 0.3};
  for (const std::size_t i : {0U, 1U, 3U}) EXPECT_EQ(internal::table_at(x, y, x[i]), y[i]);
  EXPECT_NEAR(internal::table_at(x, y, 0.2), 0.4, 1e-12);
  EXPECT_NEAR(internal::table_at(x, y, 0.4), 0.9, 1e-12);
  EXPECT_EQ(internal::table_at(x, y, 0.0), 0.1);
  EXPECT_EQ(internal::table_at(x, y, 9.0), 0.3);
}

double variance(const Cumulative& noise) { return std::pow(noise.standard_deviation(), 2); }

TEST(NoiseAt, MixesNeighboursByTheFractionalDistance) {
  const NonparametricChannel channel = two_levels();
  EXPECT_NEAR(variance(noise_at(channel, -5)), 1.0 / 3, 1e-12);
  EXPECT_NEAR(variance(noise_at(channel, 25)), 0.75 / 3 + 0.25 * 16 / 3, 1e-12);
  EXPECT_NEAR(noise_at(channel, 25).below(1), 1 - 0.25 * 3 / 8, 1e-12);
  EXPECT_NEAR(variance(noise_at(channel, 100)), 16.0 / 3, 1e-12);
}

// V + K above the brightest level, in the shape that it has there.
TEST(NoiseAt, GoesOnByPhotonTransfer) {
  const NonparametricChannel channel = two_levels();
  for (const double signal : {100.0, 101.0, 300.0, 4000.0}) {
    const Cumulative noise = noise_at(channel, signal, 0.5);
    EXPECT_NEAR(variance(noise), 16.0 / 3 + 0.5 * (signal - 100), 1e-9);
    EXPECT_NEAR(noise.x.back() / noise.standard_deviation(), std::sqrt(3), 1e-9);
  }
  EXPECT_NEAR(variance(noise_at(channel, 4000)), 16.0 / 3, 1e-12);
}

TEST(EqualBins, HoldTheDistributionAndItsRounding) {
  const Cumulative noise = noise_at(two_levels(), 100);
  const auto moments = [](const std::vector<double>& p, double width) {
    double total = 0, square = 0;
    for (std::size_t b = 0; b < p.size(); ++b) {
      const double x = width * (static_cast<double>(b) - 0.5 * static_cast<double>(p.size() - 1));
      total += p[b];
      square += p[b] * (x * x + width * width / 12);
    }
    EXPECT_NEAR(total, 1, 1e-12);
    return square;
  };
  EXPECT_NEAR(moments(equal_bins(noise, 0.1, 121), 0.1), 16.0 / 3 + 0.01 / 6, 2e-3);
  EXPECT_NEAR(moments(equal_bins(noise, 0.1, 121, 1.0), 0.1), 16.0 / 3 + 1.0 / 12 + 0.01 / 6, 2e-3);
  const auto ends = equal_bins(noise, 1.0, 3);  // -1.5 to 1.5: the rest counts to the ends
  EXPECT_NEAR(ends[0], 3.5 / 8, 1e-12);
  EXPECT_NEAR(ends[1], 1.0 / 8, 1e-12);
}

TEST(LevelRanges, ReachHalfAStepOnAndKnowTheirGain) {
  NonparametricCalibration calibration;
  calibration.channels = {two_levels(), two_levels()};
  calibration.channels[1].level_dn = {10, 20};
  auto ranges = level_ranges(calibration);
  EXPECT_DOUBLE_EQ(ranges[0].brightest_dn, 150);
  EXPECT_DOUBLE_EQ(ranges[1].darkest_dn, 5);
  EXPECT_FALSE(ranges[0].continued);
  calibration.K = {0.5, std::numeric_limits<double>::quiet_NaN()};
  ranges = level_ranges(calibration);
  EXPECT_TRUE(ranges[0].continued);
  EXPECT_FALSE(ranges[1].continued);
  const auto common = common_ranges({ranges[0]}, {ranges[1]});
  EXPECT_DOUBLE_EQ(common[0].darkest_dn, 5);
  EXPECT_DOUBLE_EQ(common[0].brightest_dn, 25);
  EXPECT_FALSE(common[0].continued);
}

// What a denoiser is told above the levels is what sampling draws there.
TEST(NonparametricProfile, GoesOnByPhotonTransfer) {
  NoiseModel model;
  model.layout = SensorLayout::named("mono");
  NonparametricCalibration calibration;
  calibration.gain = testing::db(0);
  calibration.channels = {two_levels()};
  model.nonparametric = {calibration};
  const auto at_500 = [&] { return model.profile_at(testing::db(0)).channels[0]; };
  EXPECT_NEAR(at_500().variance(500), 16.0 / 3, 1e-9);
  model.nonparametric[0].K = {0.5};
  const double expected = 16.0 / 3 + 0.5 * 400;
  EXPECT_NEAR(at_500().variance(500), expected, 1e-9);
  const auto square = [](double x) { return (x - 500) * (x - 500); };
  EXPECT_NEAR(at_500().law->expectations(square, {500.0})[0], expected, 1e-6 * expected);
}

}  // namespace
}  // namespace malus
