// Truth: means of draws of single pixels.
#include "malus/noise/frame_mean.h"

#include "malus/base/random.h"
#include "malus/noise/model.h"
#include "malus/noise/physics.h"
#include "malus/noise/tukey_lambda.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

PhysicsNoise camera(double lambda) {
  PhysicsNoise noise;
  noise.channels = {{.gain_dn_per_e = 0.5,
                     .lambda = lambda,
                     .mu_dn = 3,
                     .sigma_tl_dn = 1.5,
                     .sigma_row_dn = 0.8}};
  noise.quantization_dn = 1;
  return noise;
}

TEST(MeanOfFrames, OneIsTheFrameItself) {
  const NoiseProfile one = profile_of(camera(0.1)), same = mean_of_frames(one, 1);
  EXPECT_EQ(same.step_dn, one.step_dn);
  EXPECT_EQ(same.channels[0].variance(200), one.channels[0].variance(200));
}

TEST(MeanOfFrames, WhatIsDrawnAnewFallsAndTheRestStays) {
  NoiseProfile one = profile_of(camera(0.1));
  one.channels[0].sigma_column_dn = 0.4;
  one.channels[0].guessed_dn2 = 0.9;
  one.dark_was_cut_off = true;
  const NoiseProfile nine = mean_of_frames(one, 9);
  for (const double light : {0.0, 10.0, 500.0})
    EXPECT_DOUBLE_EQ(nine.channels[0].variance(light), one.channels[0].variance(light) / 9);
  EXPECT_DOUBLE_EQ(nine.channels[0].sigma_row_dn, 0.8 / 3);
  EXPECT_DOUBLE_EQ(nine.channels[0].sigma_column_dn, 0.4 / 3);
  EXPECT_DOUBLE_EQ(nine.channels[0].guessed_dn2, 0.1);
  EXPECT_DOUBLE_EQ(nine.channels[0].bias_dn, 3);
  EXPECT_DOUBLE_EQ(nine.channels[0].gain_dn_per_e, 0.5);
  EXPECT_FALSE(nine.dark_was_cut_off);
}

TEST(MeanOfFrames, ACameraThatAveragesRoundsOnceMore) {
  const NoiseProfile one = profile_of(camera(0.1));
  const NoiseProfile rounded = mean_of_frames(one, 9, MeanValues::kRounded);
  EXPECT_DOUBLE_EQ(rounded.channels[0].variance(100), one.channels[0].variance(100) / 9 + 1.0 / 12);
  EXPECT_EQ(rounded.step_dn, 1);
}

// Level by level and fourth moments: the law is the one that stabilisation integrates over.
TEST(MeanOfFrames, TheLawHasTheMeansVariance) {
  const NoiseProfile four = mean_of_frames(profile_of(camera(0.1)), 4);
  const NoiseLaw law = four.channels[0].distribution();
  for (const double light : {0.0, 5.0, 300.0}) {
    const double variance =
        law.expectations([&](double x) { return (x - light) * (x - light); }, {light}).front();
    EXPECT_NEAR(variance / four.channels[0].variance(light), 1, 1e-3) << light;
  }
}

// A mean of three of a heavy-tailed read noise; the rarest count below is some 180, known to 7 %.
TEST(MeanOfFrames, KeepsTheTailsOfAHeavyReadNoise) {
  constexpr double kLambda = -0.25, kScale = 1.5;
  constexpr int kMeans = 1'000'000, kFrames = 3;
  const NoiseProfile mean = mean_of_frames(profile_of(camera(kLambda)), kFrames);
  RandomSequence random(11, 0, Draw::kOther);
  double beyond[3] = {};
  constexpr double kAt[3] = {10, 15, 25};  // DN
  for (int i = 0; i < kMeans; ++i) {
    double sum = 0;
    for (int k = 0; k < kFrames; ++k)
      sum += kScale * tukey_lambda_quantile(random.uniform(), kLambda) / kFrames;
    for (int t = 0; t < 3; ++t) beyond[t] += std::abs(sum) > kAt[t];
  }
  for (int t = 0; t < 3; ++t) {
    ASSERT_GT(beyond[t], 150) << kAt[t];
    EXPECT_NEAR(mean.channels[0].law->read_tail(kAt[t]) * kMeans / beyond[t], 1, 0.35) << kAt[t];
  }
}

}  // namespace
}  // namespace malus
