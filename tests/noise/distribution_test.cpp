// The numeric pixel distribution against closed forms, brute-force integration and moments.
#include "malus/noise/distribution.h"

#include "malus/noise/tukey_lambda.h"

#include <cmath>

#include "pixel_expectation.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::expectation_of;

TEST(ReadDistribution, ConvolutionAgreesWithBruteForceIntegration) {
  for (const double lambda : {-0.3, 0.0, 0.14, 0.3})
    for (const double q : {0.01, 0.3, 1.0, 20.0}) {
      const ReadDistribution d(lambda, 1.7, q);
      for (const double x : {-9.0, -2.0, 0.0, 0.4, 3.0}) {
        constexpr int kSteps = 4000;  // midpoint rule on the definition
        double sum = 0;
        for (int i = 0; i < kSteps; ++i)
          sum += tukey_lambda_cdf((x + q * ((i + 0.5) / kSteps - 0.5)) / 1.7, lambda);
        EXPECT_NEAR(d.cdf(x), sum / kSteps, 2e-6) << lambda << ' ' << q << ' ' << x;
      }
    }
}

TEST(ReadDistribution, QuantileInvertsCdfDeepInTheTails) {
  for (const double lambda : {-0.3, 0.0, 0.3})
    for (const double q : {0.0, 0.02, 1.0}) {
      const ReadDistribution d(lambda, 0.9, q);
      for (const double p : {1e-9, 1e-6, 1e-3, 0.2, 0.5}) {
        EXPECT_NEAR(d.cdf(d.quantile(p)) / p, 1.0, 1e-6) << lambda << ' ' << q << ' ' << p;
        EXPECT_NEAR(d.upper_tail(-d.quantile(p)) / p, 1.0, 1e-6);
      }
    }
}

TEST(ReadDistribution, NodesIntegrateTheVariance) {
  for (const double lambda : {-0.2, 0.0, 0.14, 1.0}) {
    const ReadDistribution d(lambda, 1.3, 1.0);
    double second = 0, first = 0;
    for (const auto& node : d.nodes()) {
      first += node.weight * node.x_dn;
      second += node.weight * node.x_dn * node.x_dn;
    }
    EXPECT_NEAR(first, 0, 1e-12);
    EXPECT_NEAR(second / (1.69 * tukey_lambda_variance(lambda) + 1.0 / 12), 1.0, 1e-5) << lambda;
  }
}

TEST(ReadDistribution, WithoutReadNoiseIsUniform) {
  const ReadDistribution d(0.1, 0.0, 2.0);
  EXPECT_DOUBLE_EQ(d.cdf(0.5), 0.75);
  EXPECT_DOUBLE_EQ(d.quantile(0.25), -0.5);
  EXPECT_DOUBLE_EQ(d.variance_dn2(), 4.0 / 12);
}

TEST(PixelDistribution, MomentsFollowTheFormationModel) {
  const PhysicsChannel channel{0.7, 0.1, -2.0, 1.1, 0.0};
  for (const double signal : {-3.0, 0.0, 0.5, 40.0, 2000.0}) {
    const PixelDistribution d(channel, {}, 1.0, signal);
    const double variance = pixel_variance_dn2(channel, signal, 1.0);
    EXPECT_NEAR(d.mean_dn(), signal - 2.0, 1e-12);
    EXPECT_NEAR(d.variance_dn2(), variance, 1e-9 * variance);
    EXPECT_NEAR(expectation_of([](double x) { return x; }, d), signal - 2.0, 1e-6);
    EXPECT_NEAR(
        expectation_of([&](double x) { return std::pow(x - signal + 2.0, 2); }, d) / variance, 1.0,
        1e-6);
    for (const double u : {1e-6, 0.3, 0.5, 0.9, 1 - 1e-6})
      EXPECT_NEAR(d.cdf(d.quantile(u)), u, 1e-9) << signal;
    EXPECT_NEAR(d.cdf(signal) + d.upper_tail(signal), 1.0, 1e-10);
  }
}

TEST(PixelDistribution, PureShotNoiseIsPoisson) {
  const PhysicsParts shot_only{
      .shot = true, .read = false, .row = false, .quantization = false, .bias = false};
  const PixelDistribution d({.gain_dn_per_e = 2.0}, shot_only, 0.0, 6.0);
  double cumulated = 0;
  for (int n = 0; n < 10; ++n) {
    cumulated += std::exp(-3.0 + n * std::log(3.0) - std::lgamma(n + 1.0));
    EXPECT_NEAR(d.cdf(2.0 * n + 1.0), cumulated, 1e-12);  // between two levels
  }
}

}  // namespace
}  // namespace malus
