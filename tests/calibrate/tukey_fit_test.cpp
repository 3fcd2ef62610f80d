#include "malus/calibrate/internal/tukey_fit.h"

#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/noise/tukey_lambda.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

struct Truth {
  double lambda, scale_dn;
};

// Residuals of an integer converter whose pixels have offsets spread over a step; noise(random)
// draws in DN.
template <class Noise>
ResidualHistogram rounded_residuals(const Noise& draw, int samples, std::uint64_t seed,
                                    double cell_dn) {
  RandomSequence random(seed, 0, Draw::kOther);
  std::vector<std::uint32_t> dense(400, 0);
  std::vector<std::int32_t> beyond;
  for (int i = 0; i < samples; ++i) {
    const double offset = random.uniform();
    const double noise = draw(random);
    const double cell = std::abs(std::round(offset + noise) - offset) / cell_dn;
    if (cell < 400)
      ++dense[static_cast<std::size_t>(cell)];
    else
      beyond.push_back(static_cast<std::int32_t>(cell));
  }
  ResidualHistogram histogram(cell_dn);
  histogram.assign(dense, beyond);
  return histogram;
}

ResidualHistogram rounded_sample(Truth truth, int samples, std::uint64_t seed, double cell_dn) {
  return rounded_residuals(
      [truth](RandomSequence& random) {
        return truth.scale_dn * tukey_lambda_quantile(random.uniform(), truth.lambda);
      },
      samples, seed, cell_dn);
}

TEST(ResidualHistogram, AddsCellsAndKeepsTheFarOnes) {
  ResidualHistogram a(0.5), b(0.5);
  std::vector<std::int32_t> far{900, 700, 900}, none;
  a.assign({1, 0, 2}, far);
  b.assign({0, 5, 1}, none);
  a.add(b);
  ASSERT_EQ(a.cells().size(), 5u);
  EXPECT_EQ(a.count(), 12);
  EXPECT_EQ(a.cells()[1].count, 5u);
  EXPECT_EQ(a.cells()[2].count, 3u);
  EXPECT_EQ(a.cells()[4].index, 900);
  EXPECT_EQ(a.cells()[4].count, 2u);
}

class TukeyFitTruth : public ::testing::TestWithParam<Truth> {};

// Over independent samples the estimates scatter as the fit says and their mean is the truth: four
// standard errors of the mean of 40, and a factor on the scatter that chance exceeds in < 1e-4.
TEST_P(TukeyFitTruth, IsUnbiasedWithTheScatterItClaims) {
  const Truth truth = GetParam();
  constexpr int kRepeats = 40, kSamples = 10000;
  Moments lambda, scale;
  for (int i = 0; i < kRepeats; ++i) {
    const auto histogram = rounded_sample(truth, kSamples, 100u + static_cast<std::uint64_t>(i),
                                          0.07 * truth.scale_dn);
    const auto fit = fit_tukey_lambda(histogram, {1.0, 0.0});
    ASSERT_TRUE(fit.decided()) << fit.reason();
    lambda.add((fit->lambda - truth.lambda) / std::sqrt(fit->unit_covariance[0] / kSamples));
    scale.add(std::log(fit->scale_dn / truth.scale_dn) /
              std::sqrt(fit->unit_covariance[2] / kSamples));
  }
  for (const Moments& z : {lambda, scale}) {
    EXPECT_LT(std::abs(z.mean()), 4.0 / std::sqrt(kRepeats));
    EXPECT_GT(z.variance(), 0.4);
    EXPECT_LT(z.variance(), 1.9);
  }
}

INSTANTIATE_TEST_SUITE_P(ShapesAndScales, TukeyFitTruth,
                         ::testing::Values(Truth{-0.2, 1.0}, Truth{0.0, 0.5}, Truth{0.0, 4.0},
                                           Truth{0.14, 0.5}, Truth{0.14, 10.0}, Truth{0.3, 1.0}));

// For λ > 0 a sample near the end of the support, at scale/λ, could pin λ and claim to know it: of
// normal noise, which is λ = 0.136 but for that end, estimates were 4 stated errors off (root mean
// square, which of 40 has a standard deviation of 0.11).
TEST(TukeyFit, StatesItsErrorWhereOneFarSampleCouldDecide) {
  constexpr int kRepeats = 40, kSamples = 200000;
  for (const double lambda : {0.135, 0.5, 99.0}) {
    Moments found, z;
    for (std::uint64_t i = 0; i < kRepeats; ++i) {
      const auto histogram =
          lambda > 1 ? rounded_residuals([](RandomSequence& r) { return 6.0 * r.normal(); },
                                         kSamples, 700 + i, 0.25)
                     : rounded_sample({lambda, 8.0}, kSamples, 700 + i, 0.3);
      const auto fit = fit_tukey_lambda(histogram, {1.0, 0.0});
      ASSERT_TRUE(fit.decided());
      found.add(fit->lambda);
      const double about = lambda > 1 ? 0.1358 : lambda;  // that of 75 million normal samples
      z.add((fit->lambda - about) / std::sqrt(fit->unit_covariance[0] / kSamples));
    }
    EXPECT_LT(std::sqrt(z.variance() + z.mean() * z.mean()), 1.4) << lambda;
    EXPECT_GT(std::sqrt(z.variance() + z.mean() * z.mean()), 0.6) << lambda;
    EXPECT_LT(std::sqrt(found.variance()), 0.0035) << lambda;
  }
}

// Why maximum likelihood is the default: with noise of about one step the probability plot takes
// the rounding for a rounder shape.
TEST(TukeyFitPpcc, AgreesOnFineStepsAndIsBiasedOnCoarseOnes) {
  Moments fine, coarse;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    fine.add(
        fit_tukey_lambda_ppcc(rounded_sample({0.0, 20.0}, 20000, seed, 1.0), {1.0, 0.0})->lambda);
    coarse.add(
        fit_tukey_lambda_ppcc(rounded_sample({0.0, 0.4}, 20000, seed, 0.03), {1.0, 0.0})->lambda);
  }
  EXPECT_NEAR(fine.mean(), 0.0, 0.02);
  EXPECT_GT(coarse.mean(), 0.02);
}

TEST(TukeyFit, TakesTheOffsetsErrorOut) {
  // Residuals widened by a known normal error: the shape must not move towards the normal one.
  RandomSequence random(7, 0, Draw::kOther);
  std::vector<std::uint32_t> dense(600, 0);
  std::vector<std::int32_t> beyond;
  const double cell_dn = 0.1, blur_dn2 = 1.0;
  constexpr int kSamples = 400000;
  for (int i = 0; i < kSamples; ++i) {
    const double r =
        2.0 * tukey_lambda_quantile(random.uniform(), -0.1) + std::sqrt(blur_dn2) * random.normal();
    const double cell = std::abs(r) / cell_dn;
    if (cell < 600)
      ++dense[static_cast<std::size_t>(cell)];
    else
      beyond.push_back(static_cast<std::int32_t>(cell));
  }
  ResidualHistogram histogram(cell_dn);
  histogram.assign(dense, beyond);
  const auto fit = fit_tukey_lambda(histogram, {0.0, blur_dn2});
  ASSERT_TRUE(fit.decided());
  EXPECT_NEAR(fit->lambda, -0.1, 4 * std::sqrt(fit->unit_covariance[0] / kSamples));
  EXPECT_NEAR(fit->scale_dn, 2.0, 8 * std::sqrt(fit->unit_covariance[2] / kSamples));
}

// Noise that ends abruptly, widened by the error of its offset. λ of 0.8 came out as 0.789, and of
// 1 as 0.966 or not at all. Four standard errors of the mean of 30; the scatter's limits are those
// that chance passes in 1e-4.
TEST(TukeyFit, FollowsNoiseThatEndsAbruptly) {
  constexpr int kRepeats = 30, kSamples = 100000;
  constexpr double kBlurDn = 0.7, kCellDn = 0.125;
  for (const double lambda : {0.5, 0.8, 1.0}) {
    Moments z, scale;
    for (std::uint64_t i = 0; i < kRepeats; ++i) {
      const double scale_dn = 3.0 / std::sqrt(tukey_lambda_variance(lambda));
      const auto draw = [&](RandomSequence& r) {
        return scale_dn * tukey_lambda_quantile(r.uniform(), lambda) + kBlurDn * r.normal();
      };
      const auto fit = fit_tukey_lambda(rounded_residuals(draw, kSamples, 40 + i, kCellDn),
                                        {1.0, kBlurDn * kBlurDn});
      ASSERT_TRUE(fit.decided()) << fit.reason();
      z.add((fit->lambda - lambda) / std::sqrt(fit->unit_covariance[0] / kSamples));
      scale.add(std::log(fit->scale_dn / scale_dn) / std::sqrt(fit->unit_covariance[2] / kSamples));
    }
    for (const Moments& m : {z, scale}) {
      EXPECT_LT(std::abs(m.mean()), 4.0 / std::sqrt(kRepeats)) << lambda;
      EXPECT_GT(m.variance(), 0.35) << lambda;
      EXPECT_LT(m.variance(), 2.1) << lambda;
    }
  }
}

TEST(TukeyFit, SaysWhyItCannotDecide) {
  const auto few = fit_tukey_lambda(rounded_sample({0.1, 1.0}, 50, 1, 0.05), {1.0, 0.0});
  ASSERT_FALSE(few.decided());
  EXPECT_NE(few.reason().find("50 samples"), std::string::npos);
  ResidualHistogram constant(0.1);
  std::vector<std::int32_t> none;
  constant.assign({1000}, none);
  EXPECT_FALSE(fit_tukey_lambda(constant, {1.0, 0.0}).decided());
}

TEST(FrameShapes, FramesAverageToThePooledFit) {
  constexpr double kCell = 0.05;
  std::vector<ResidualHistogram> frames;
  ResidualHistogram pooled(kCell);
  for (std::uint64_t i = 0; i < 30; ++i) {
    frames.push_back(rounded_sample({0.05, 1.0}, 500, 50 + i, kCell));
    pooled.add(frames.back());
  }
  const ResidualBlur blur{1.0, 0.0};
  const auto fit = fit_tukey_lambda(pooled, blur);
  ASSERT_TRUE(fit.decided());
  const FrameShapes shapes(*fit, pooled, blur);
  double lambda = 0, scale = 0;
  for (const auto& frame : frames) {
    lambda += shapes.of(frame).lambda / 30;
    scale += shapes.of(frame).log_scale / 30;
  }
  EXPECT_NEAR(lambda, fit->lambda, 1e-3);
  EXPECT_NEAR(scale, std::log(fit->scale_dn), 1e-3);
}

}  // namespace
}  // namespace malus
