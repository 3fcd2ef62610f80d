#include "malus/noise/clipped_noise.h"

#include "malus/noise/stabilize.h"

#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

// Codes of a camera whose lowest one is `floor`: Poisson of the slope, normal read noise.
class ClippedCamera {
 public:
  ClippedCamera(double slope_dn, double read_dn, LowestCode floor)
      : slope_dn_(slope_dn), read_(0.0, read_dn), floor_(floor) {}
  double operator()(double signal_dn, std::mt19937_64& random) {
    double dn = signal_dn;
    if (slope_dn_ > 0 && signal_dn > 0)
      dn = slope_dn_ * std::poisson_distribution<int>(signal_dn / slope_dn_)(random);
    dn += read_(random) - floor_.dn;
    if (floor_.step_dn > 0) dn = floor_.step_dn * std::round(dn / floor_.step_dn);
    return floor_.dn + std::max(dn, 0.0);
  }

 private:
  double slope_dn_;
  std::normal_distribution<double> read_;
  LowestCode floor_;
};

constexpr int kDraws = 400000;  // errors below are of 5 standard errors: level 6e-7 each

MeanAndVariance drawn(ClippedCamera camera, double signal_dn, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  double sum = 0, squares = 0;
  for (int i = 0; i < kDraws; ++i) {
    const double dn = camera(signal_dn, random);
    sum += dn;
    squares += dn * dn;
  }
  const double mean = sum / kDraws;
  return {mean, squares / kDraws - mean * mean};
}

TEST(ClippedNoise, MomentsAreThoseOfDrawnPixels) {
  for (const double step : {0.0, 0.05, 0.7, 1.6})
    for (const double signal : {-0.5, 0.0, 0.4, 1.0, 3.0}) {
      const LowestCode floor{-0.2, step};
      const MeanAndVariance shown = drawn({0, 0.9, floor}, signal, 7);
      const MeanAndVariance told = clipped_moments({signal, 0.81 + step * step / 12}, floor);
      EXPECT_NEAR(told.mean_dn, shown.mean_dn, 5 * 0.9 / std::sqrt(kDraws))
          << step << " " << signal;
      EXPECT_NEAR(told.variance_dn2, shown.variance_dn2, 5 * 1.8 * 0.9 / std::sqrt(kDraws))
          << step << " " << signal;
    }
}

TEST(ClippedNoise, MomentsBeforeComeBack) {
  for (const double step : {0.0, 0.3, 1.0})
    for (const double signal : {0.0, 0.5, 2.0, 5.0}) {
      const LowestCode floor{-1.0, step};
      const double variance = 2.25 + step * step / 12;
      const MeanAndVariance before =
          moments_before_clipping(clipped_moments({signal, variance}, floor), floor);
      EXPECT_NEAR(before.mean_dn, signal, 1e-3) << step;
      EXPECT_NEAR(before.variance_dn2, variance, 2e-3) << step;
    }
}

// Far above the floor both are what they were; a mean at the floor is no reason for a NaN.
TEST(ClippedNoise, NothingIsCutOffFarAbove) {
  const MeanAndVariance far = clipped_moments({20.0, 4.0}, {0.0, 1.0});
  EXPECT_EQ(far.mean_dn, 20.0);
  EXPECT_EQ(far.variance_dn2, 4.0);
  EXPECT_EQ(moments_before_clipping({20.0, 4.0}, {0.0, 1.0}).variance_dn2, 4.0);
  EXPECT_EQ(moments_before_clipping({0.0, 0.1}, {0.0, 1.0}).mean_dn, 0.0);
  EXPECT_TRUE(std::isfinite(moments_before_clipping({1e-3, 1e-3}, {0.0, 1.0}).variance_dn2));
}

TEST(ClippedNoise, CurveIsTheVarianceAgainstTheMeanThatShows) {
  for (const VarianceCurve& variance :
       {VarianceCurve::affine(0.4, 1.5), VarianceCurve::table({0, 10}, {1.5, 5.5}, 0.4)}) {
    const VarianceCurve shown = clipped_variance(variance, {0.0, 1.0}, 1000);
    for (const double signal : {0.0, 0.3, 1.0, 2.5}) {
      const MeanAndVariance moments = clipped_moments({signal, variance(signal)}, {0.0, 1.0});
      EXPECT_NEAR(shown(moments.mean_dn), moments.variance_dn2, 2e-3);
    }
    EXPECT_NEAR(shown(700.0), variance(700.0), 1e-2);
  }
}

// The mean of many stabilised pixels gives the light back, where the pixels' own mean is up to 0.4
// deviations too high.
TEST(ClippedNoise, StabilizerGivesTheLightBefore) {
  const double slope = 0.4, read = 1.2;
  for (const double step : {0.0, 1.0}) {
    const LowestCode floor{0.0, step};
    const VarianceCurve variance = VarianceCurve::affine(slope, read * read + step * step / 12);
    const ChannelProfile shown = clipped_channel({.variance = variance}, floor, 4095);
    const Stabilizer stabilizer(shown.variance, 4095, *shown.law);
    ClippedCamera camera(slope, read, floor);
    for (const double signal : {0.0, 0.2, 0.8, 2.0, 6.0, 50.0}) {
      std::mt19937_64 random(11);
      double sum = 0, plain = 0;
      for (int i = 0; i < kDraws; ++i) {
        const double dn = camera(signal, random);
        sum += stabilizer.forward(dn);
        plain += dn / kDraws;
      }
      const double error = std::sqrt(variance(signal) / kDraws);
      EXPECT_NEAR(stabilizer.inverse(sum / kDraws), signal, 10 * error + 2e-3 * read)
          << step << " " << signal;
      if (signal == 0) {
        EXPECT_GT(plain, 0.4);
      }
    }
  }
}

TEST(ClippedNoise, DarkFramesThatWereCutOffTellTheirOwnNoise) {
  const VarianceCurve variance = VarianceCurve::affine(0.4, 1.44 + 1.0 / 12);
  const MeanAndVariance dark = clipped_moments({0.1, variance(0)}, {0.0, 1.0});
  const ChannelProfile calibrated{.variance = VarianceCurve::affine(0.4, dark.variance_dn2),
                                  .bias_dn = dark.mean_dn};
  const ChannelProfile before = channel_before_clipping(calibrated, {0.0, 1.0});
  EXPECT_NEAR(before.bias_dn, 0.1, 1e-3);
  EXPECT_NEAR(before.variance(0), variance(0), 2e-3);
  EXPECT_NEAR(before.variance(100) - before.variance(0), 40, 1e-6);
}

}  // namespace
}  // namespace malus
