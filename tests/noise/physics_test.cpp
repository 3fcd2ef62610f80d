#include "malus/noise/physics.h"

#include "malus/noise/tukey_lambda.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

// 24 frames whose scale goes up and down by d about 2 DN, and whose shape by l about 0.1.
PhysicsCalibration alternating(double d, double l, int frames = 24) {
  PhysicsCalibration p;
  p.K.mean = {0.5};
  p.K.standard_error = {0.0};
  p.sigma_tl.mean = {2.0};
  p.lambda.mean = {0.1};
  for (int f = 0; f < frames; ++f) {
    const double sign = f % 2 ? -1.0 : 1.0;
    p.sigma_tl.per_frame.push_back({2.0 + sign * d});
    p.lambda.per_frame.push_back({0.1 + sign * l});
  }
  return p;
}

TEST(ReadNoise, HasTheStandardErrorOfItsFrames) {
  // Variance over 24 frames d² 24 / 23, of their mean 1/23 of that (one frame's worth is lost).
  const double scatter = 0.05 * std::sqrt(24.0 / 23.0) / std::sqrt(23.0);
  PhysicsCalibration p = alternating(0.05, 0);
  const double of_one = std::sqrt(tukey_lambda_variance(0.1)) / 0.5;
  EXPECT_NEAR(read_noise_stderr_e(p)[0], scatter * of_one, 1e-12);
  p.K.standard_error = {0.01};
  EXPECT_NEAR(read_noise_stderr_e(p)[0], of_one * std::hypot(scatter, 2 * 0.02), 1e-12);
}

// Shape and scale of one frame are estimated together: what one gains of the noise the other loses.
TEST(ReadNoise, HasNoErrorFromShapesAndScalesThatMakeOneNoise) {
  constexpr double kShape = 0.002;
  const double slope =
      std::log(tukey_lambda_variance(0.1 + kShape) / tukey_lambda_variance(0.1)) / (2 * kShape);
  const PhysicsCalibration same = alternating(-2.0 * slope * kShape, kShape);
  const PhysicsCalibration both = alternating(2.0 * slope * kShape, kShape);
  const double alone = read_noise_stderr_e(alternating(2.0 * slope * kShape, 0))[0];
  EXPECT_LT(read_noise_stderr_e(same)[0], 0.02 * alone);
  EXPECT_NEAR(read_noise_stderr_e(both)[0], 2 * alone, 0.02 * alone);
}

TEST(ReadNoise, HasNoErrorThatIsKnownFromFewFrames) {
  EXPECT_TRUE(std::isnan(read_noise_stderr_e(alternating(0.05, 0, 19))[0]));
  EXPECT_TRUE(std::isnan(read_noise_stderr_e(alternating(0.05, 0, 0))[0]));
  PhysicsCalibration p = alternating(0.05, 0, 20);
  EXPECT_FALSE(std::isnan(read_noise_stderr_e(p)[0]));
  p.K.standard_error.clear();
  EXPECT_TRUE(std::isnan(read_noise_stderr_e(p)[0]));
}

}  // namespace
}  // namespace malus
