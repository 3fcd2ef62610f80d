#include "malus/calibrate/internal/across_frames.h"

#include "malus/base/random.h"
#include "malus/base/statistics.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kChannels = 16, kManyFrames = 60, kSeeds = 40;

// One value per frame and channel: 5, a real change of `real`, of which half its variance is common
// to all channels, and a sampling error of 1.
FrameSeries drawn(double real, std::uint32_t seed) {
  RandomSequence random(5, seed, Draw::kOther);
  FrameSeries series;
  for (int i = 0; i < kManyFrames; ++i) {
    const double common = random.normal();
    auto& frame = series.emplace_back();
    for (int c = 0; c < kChannels; ++c)
      frame.push_back(5 + real * std::sqrt(0.5) * (common + random.normal()) + random.normal());
  }
  return series;
}

double trace(const SquareMatrix& matrix) {
  double sum = 0;
  for (int c = 0; c < matrix.n; ++c) sum += matrix(c, c);
  return sum;
}

// Mean variance of a channel, and mean covariance of two.
struct Found {
  Moments variance, covariance;
};

Found found(double real) {
  Found all;
  for (std::uint32_t seed = 0; seed < kSeeds; ++seed) {
    const ChannelStatistics s =
        frame_statistics(drawn(real, seed), SquareMatrix::identity(kChannels));
    EXPECT_LT(largest_difference(s.covariance, nearest_semidefinite(s.covariance)), 1e-9);
    for (int a = 0; a < kChannels; ++a) {
      EXPECT_NEAR(std::pow(s.spread[static_cast<std::size_t>(a)], 2), s.covariance(a, a), 1e-12);
      all.variance.add(s.covariance(a, a));
      for (int b = 0; b < a; ++b) all.covariance.add(s.covariance(a, b));
    }
  }
  return all;
}

// What is negative among the eigenvalues of pure sampling error was cut off, and 0.23 was left.
TEST(AcrossFrames, SamplingErrorAloneIsNoChange) {
  const Found nothing = found(0);
  EXPECT_LT(nothing.variance.mean(), 0.03);
  EXPECT_NEAR(nothing.covariance.mean(), 0, 0.01);
}

TEST(AcrossFrames, ARealChangeIsFoundAsItIs) {
  for (const double real : {0.5, 1.0, 3.0}) {
    const Found some = found(real);
    EXPECT_NEAR(some.variance.mean() / (real * real), 1, 0.06) << real;
    // Half as large as the sampling error it was 0.43 of the truth, and as large 0.87.
    EXPECT_NEAR(some.covariance.mean() / (0.5 * real * real), 1, real < 1 ? 0.25 : 0.06) << real;
  }
}

// Channels whose deviation is not significant do not change, and get nothing of the others'.
TEST(AcrossFrames, WhatIsNotSignificantDoesNotChange) {
  FrameSeries series = drawn(3, 1);
  for (auto& frame : series) frame[2] = frame[3] = -frame[2] + 3;
  const ChannelStatistics s = deviation_statistics(series, SquareMatrix::identity(kChannels));
  for (const std::size_t c : {2u, 3u}) EXPECT_EQ(s.spread[c], 0.0);
  EXPECT_GT(s.spread[0], 0.0);
}

TEST(AcrossFrames, TheVariancesSumUpToWhatSamplingLeaves) {
  for (const double real : {0.0, 0.2, 1.0})
    for (std::uint32_t seed = 0; seed < 10; ++seed) {
      const FrameSeries series = drawn(real, seed);
      const double left = trace(frame_covariance(series)) - kChannels;
      const ChannelStatistics s = frame_statistics(series, SquareMatrix::identity(kChannels));
      EXPECT_NEAR(trace(s.covariance), std::max(left, 0.0), 1e-9);
    }
}

}  // namespace
}  // namespace malus
