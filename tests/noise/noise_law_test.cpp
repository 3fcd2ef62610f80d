// Truth: the first two moments of every kind's noise, known in closed form.
#include "malus/noise/noise_law.h"

#include "malus/noise/distribution.h"
#include "malus/noise/stabilize.h"
#include "malus/noise/tukey_lambda.h"

#include <cmath>

#include "pixel_expectation.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::expectation_of;

void expect_moments(const NoiseLaw& law, double signal, double mean, double variance,
                    double of_variance = 1e-5) {
  const double first = law.expectations([](double x) { return x; }, {signal}).front();
  const double second =
      law.expectations([&](double x) { return (x - mean) * (x - mean); }, {signal}).front();
  EXPECT_NEAR(first, mean, 1e-6 * (1 + std::sqrt(variance))) << signal;
  EXPECT_NEAR(second, variance, of_variance * (1 + variance)) << signal;
}

TEST(NoiseLaw, PhysicsHasTheVarianceOfItsParts) {
  const PhysicsChannel channel{.gain_dn_per_e = 1.5,
                               .lambda = -0.1,
                               .mu_dn = 7,  // left out
                               .sigma_tl_dn = 2,
                               .sigma_row_dn = 1};
  const double read = 4 * tukey_lambda_variance(-0.1);
  const NoiseLaw whole = NoiseLaw::physics(channel, PhysicsParts{}, 1.0);
  for (const double s : {-5.0, 0.0, 3.0, 89.0, 91.0, 2000.0})
    expect_moments(whole, s, s, 1.5 * std::max(s, 0.0) + read + 1.0 / 12);
  PhysicsParts parts;
  parts.shot = parts.quantization = false;
  expect_moments(NoiseLaw::physics(channel, parts, 1.0), 50, 50, read);
}

// Shot noise is that of the pixel's own signal, whose mean is the light. Nodes of the read noise
// that are merged once more cost 6e-4 of its variance.
TEST(NoiseLaw, PixelsThatDifferAddTheirVariance) {
  const PhysicsChannel channel{
      .gain_dn_per_e = 1.5, .lambda = 0.14, .mu_dn = 0, .sigma_tl_dn = 2, .sigma_row_dn = 0};
  const double K = 1.5, read = 4 * tukey_lambda_variance(0.14) + 1.0 / 12;
  const VarianceCurve curve = VarianceCurve::affine(K, read).with_pattern(0.02, 3);
  for (const NoiseLaw& law : {NoiseLaw::physics(channel, PhysicsParts{}, 1.0).with_pattern(0.02, 3),
                              NoiseLaw::gaussian(curve)})
    for (const double s : {-5.0, 0.0, 3.0, 89.0, 400.0, 4000.0})
      expect_moments(law, s, s, curve(s), 1e-3);
}

// Read noise alone, so that nothing else errs; the truth is summed over the whole distribution.
TEST(NoiseLaw, FarFromTheDarkFewNodesGiveTheExpectationOfAStabilisation) {
  PhysicsParts read_only;
  read_only.shot = read_only.bias = false;
  for (const double lambda : {-0.3, 0.0, 0.05, 0.14, 0.5})
    for (const double read_e : {0.3, 0.6, 2.0, 10.0}) {
      const double K = 1.5, variance_dn2 = std::pow(read_e * K, 2) + 1.0 / 12;
      const PhysicsChannel channel{
          .gain_dn_per_e = K,
          .lambda = lambda,
          .mu_dn = 0,
          .sigma_tl_dn = read_e * K / std::sqrt(tukey_lambda_variance(lambda)),
          .sigma_row_dn = 0};
      const Stabilizer stabilizer(VarianceCurve::affine(K, variance_dn2), 4000);
      const auto curve = [&](double dn) { return stabilizer.forward(dn); };
      const NoiseLaw law = NoiseLaw::physics(channel, read_only, 1.0);
      for (const double deviations : {0.0, 3.0, 7.9, 8.1, 20.0, 100.0}) {
        const double s = deviations * std::sqrt(variance_dn2);
        const PixelDistribution pixel(channel, read_only, 1.0, s);
        EXPECT_NEAR(law.expectations(curve, {s}).front(), expectation_of(curve, pixel),
                    deviations > 7 ? 1e-5 : 2e-4)
            << lambda << ", " << read_e << " e-, " << deviations;
      }
    }
}

// The quantile function is the closed form.
TEST(NoiseLaw, TailsAreThoseOfTheReadNoise) {
  for (const double lambda : {-0.3, -0.1, 0.0, 0.1})
    for (const double beyond : {0.2, 1e-3, 1e-8}) {
      const PhysicsChannel channel{.gain_dn_per_e = 1.5, .lambda = lambda, .sigma_tl_dn = 2};
      const double distance = -2 * tukey_lambda_quantile(beyond / 2, lambda);
      EXPECT_NEAR(NoiseLaw::physics(channel, PhysicsParts{}, 1.0).read_tail(distance) / beyond, 1,
                  1e-6)
          << lambda;
    }
  NonparametricChannel measured;
  measured.level_dn = {0};
  measured.bin_edges_dn = {-20, -10, -1, 1, 10, 20};
  measured.pmf = {{0.01, 0.2, 0.5, 0.27, 0.02}};
  const NoiseLaw law = NoiseLaw::measured(measured, 0);
  EXPECT_NEAR(law.read_tail(10), 0.03, 1e-12);
  EXPECT_EQ(law.read_tail(20), 0);
  EXPECT_EQ(NoiseLaw::gaussian(VarianceCurve::affine(1, 9)).read_tail(10), 0);
}

TEST(NoiseLaw, GaussianHasTheCurvesVariance) {
  const NoiseLaw affine = NoiseLaw::gaussian(VarianceCurve::affine(0.7, 9));
  const NoiseLaw table = NoiseLaw::gaussian(VarianceCurve::table({0, 100}, {9, 79}));
  const NoiseLaw none = NoiseLaw::gaussian(VarianceCurve::affine(0, 0));
  for (const double s : {0.0, 10.0, 100.0}) {
    expect_moments(affine, s, s, 0.7 * s + 9);
    expect_moments(table, s, s, 0.7 * s + 9);
    expect_moments(none, s, s, 0);
  }
}

TEST(NoiseLaw, MeasuredMixesTheLevelsAround) {
  NonparametricChannel channel;
  channel.level_dn = {10, 30};
  channel.samples = {100, 100};
  channel.bin_edges_dn = {-3, 1, 3};
  channel.pmf = {{0.5, 0.5}, {0.25, 0.75}};
  // Means 0.5 and 1.25; second moments of the uniform bins 7/3 and 13/3.
  const auto moments = [&](double share, double bias) {
    const double mean = (1 - share) * 0.5 + share * 1.25;
    const double square =
        (1 - share) * (0.5 * 7 / 3 + 0.5 * 13 / 3) + share * (0.25 * 7 / 3 + 0.75 * 13 / 3);
    return std::pair{mean - bias, square - mean * mean};
  };
  const NoiseLaw law = NoiseLaw::measured(channel, 0.5);
  for (const auto& [signal, share] :
       {std::pair{4.0, 0.0}, {10.0, 0.0}, {15.0, 0.25}, {30.0, 1.0}, {99.0, 1.0}}) {
    const auto [mean, variance] = moments(share, 0.5);
    expect_moments(law, signal, signal + mean, variance);
  }
}

}  // namespace
}  // namespace malus
