#include "malus/noise/tukey_lambda.h"

#include "malus/base/normal_distribution.h"

#include <array>
#include <cmath>
#include <numbers>

#include "support.h"

namespace malus {
namespace {

constexpr std::array kShapes = {-0.45, -0.3,  -0.1,  -0.0501, -0.0499, -1e-3, -1e-5, -1e-7, -1e-9,
                                0.0,   1e-13, 1e-11, 1e-8,    1e-6,    1e-4,  1e-2,  0.049, 0.051,
                                0.14,  0.3,   0.7,   1.0,     1.5,     2.0,   3.0,   5.0,   8.0};

// ∫ Q(u)² du by the substitution u = 1/(1+e^-t), in which the integrand decays exponentially at
// both ends for λ > -1/2, so that the trapezoidal rule converges exponentially. Powers are taken in
// long double, from their definition.
long double variance_by_integration(double lambda) {
  const long double l = lambda;
  const long double reach = 90.0L / (1.0L + 2.0L * std::min(l, 0.0L)), step = reach / 20000;
  long double sum = 0;
  for (int i = -20000; i <= 20000; ++i) {
    const long double t = i * step;
    const long double log_u = t < 0 ? t - std::log1p(std::exp(t)) : -std::log1p(std::exp(-t));
    const long double log_v = log_u - t;  // log(1-u)
    const long double q = l == 0 ? t : (std::expm1(l * log_u) - std::expm1(l * log_v)) / l;
    sum += q * q * std::exp(log_u + log_v);
  }
  return sum * step;
}

TEST(TukeyLambda, VarianceHasItsClosedForms) {
  EXPECT_DOUBLE_EQ(tukey_lambda_variance(0.0), std::numbers::pi * std::numbers::pi / 3.0);
  EXPECT_NEAR(tukey_lambda_variance(1.0), 1.0 / 3.0, 1e-15);   // uniform on [-1, 1]
  EXPECT_NEAR(tukey_lambda_variance(2.0), 1.0 / 12.0, 1e-15);  // uniform on [-1/2, 1/2]
  EXPECT_TRUE(std::isinf(tukey_lambda_variance(-0.5)));
}

TEST(TukeyLambda, VarianceAgreesWithIntegration) {
  for (double lambda : kShapes) {
    const auto truth = static_cast<double>(variance_by_integration(lambda));
    EXPECT_NEAR(tukey_lambda_variance(lambda) / truth, 1.0, 1e-12) << lambda;
  }
}

TEST(TukeyLambda, QuantileHasItsClosedForms) {
  for (double u : {1e-12, 1e-6, 0.01, 0.3, 0.5, 0.9, 1 - 1e-9}) {
    EXPECT_NEAR(tukey_lambda_quantile(u, 0.0), std::log(u / (1 - u)), 1e-7 * std::abs(std::log(u)));
    EXPECT_NEAR(tukey_lambda_quantile(u, 1.0), 2 * u - 1, 1e-15);
    EXPECT_NEAR(tukey_lambda_quantile(u, 2.0), u - 0.5, 1e-15);
  }
  EXPECT_DOUBLE_EQ(tukey_lambda_quantile(1e-12, 0.0), std::log(1e-12) - std::log1p(-1e-12));
}

// Against long double powers, where those do not cancel; and smooth across λ = 0, where they do.
TEST(TukeyLambda, QuantileKeepsItsDigits) {
  for (double lambda : kShapes)
    for (double u : {1e-300, 1e-12, 1e-6, 0.01, 0.3, 0.9, 0.999999}) {
      const long double lu = std::log(static_cast<long double>(u));
      const long double lv = std::log1p(-static_cast<long double>(u));
      const long double l = lambda;
      const long double truth =
          lambda == 0 ? lu - lv : (std::expm1(l * lu) - std::expm1(l * lv)) / l;
      EXPECT_NEAR(tukey_lambda_quantile(u, lambda) / static_cast<double>(truth), 1.0, 2e-14)
          << lambda << " " << u;
    }
}

TEST(TukeyLambda, CdfInvertsTheQuantile) {
  for (double lambda : kShapes) {
    for (double u : {1e-30, 1e-9, 1e-3, 0.2, 0.4999}) {
      const double x = tukey_lambda_quantile(u, lambda);
      // The rounding of x alone moves u by this much: u Q'(u) = u^λ + u (1-u)^(λ-1).
      const double moved =
          4e-16 * std::abs(x) / (std::pow(u, lambda) + u * std::pow(1 - u, lambda - 1));
      EXPECT_NEAR(tukey_lambda_cdf(x, lambda) / u, 1.0, 1e-12 + moved) << lambda << " " << u;
    }
    for (double u : {0.5, 0.7, 0.999})
      EXPECT_NEAR(tukey_lambda_cdf(tukey_lambda_quantile(u, lambda), lambda), u, 1e-12);
  }
  EXPECT_EQ(tukey_lambda_cdf(-1.001, 1.0), 0.0);
  EXPECT_EQ(tukey_lambda_cdf(0.501, 2.0), 1.0);
}

TEST(TukeyLambda, OneShapeIsAsGoodAsNormal) {
  const double sd = tukey_lambda_deviation(2.0, kNormalLambda);
  EXPECT_NEAR(sd * sd, 4 * tukey_lambda_variance(kNormalLambda), 1e-12);
  for (double z = 0.25; z <= 3; z += 0.25)
    EXPECT_NEAR(2 * tukey_lambda_quantile(normal_cdf(z), kNormalLambda) / sd, z,
                (z <= 2.5 ? 0.004 : 0.012) * z)
        << z;
}

TEST(TukeyLambda, DensityIsTheSlopeOfTheCdf) {
  EXPECT_NEAR(tukey_lambda_pdf(0.3, 1.0), 0.5, 1e-12);
  EXPECT_NEAR(tukey_lambda_pdf(0.3, 2.0), 1.0, 1e-12);
  EXPECT_EQ(tukey_lambda_pdf(1.5, 1.0), 0.0);
  EXPECT_NEAR(tukey_lambda_pdf(0.7, 0.0), 1.0 / (2.0 + 2.0 * std::cosh(0.7)), 1e-12);  // logistic
  for (double lambda : {-0.3, 0.0, 0.14, 0.3})
    for (double x : {-6.0, -1.5, 0.0, 0.4, 2.0}) {
      constexpr double kStep = 1e-4;
      const double slope =
          (tukey_lambda_cdf(x + kStep, lambda) - tukey_lambda_cdf(x - kStep, lambda)) / (2 * kStep);
      EXPECT_NEAR(tukey_lambda_pdf(x, lambda), slope, 1e-8) << lambda << " " << x;
    }
  for (double lambda : {3.0, 5.0, 8.0})  // too steep for steps
    for (double u : {0.02, 0.3, 0.5, 0.8}) {
      const double slope = std::pow(u, lambda - 1) + std::pow(1 - u, lambda - 1);  // dQ/du
      EXPECT_NEAR(tukey_lambda_pdf(tukey_lambda_quantile(u, lambda), lambda) * slope, 1.0, 1e-9)
          << lambda << " " << u;
    }
}

}  // namespace
}  // namespace malus
