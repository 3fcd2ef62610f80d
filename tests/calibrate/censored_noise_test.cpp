// Noise of which a good part is cut off. Truth: Tukey-lambda noise of deviation 1, whose share of
// every code is known.
#include "malus/calibrate/internal/censored_noise.h"

#include "malus/noise/data_sheet.h"
#include "malus/noise/tukey_lambda.h"

#include <cmath>

#include "simulated_session.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr double kFine = 0.01, kSamples = 1e5;

// Of a mean above the floor.
ShownNoise shown_of(double lambda, double mean_dn, double step_dn) {
  const double scale = 1.0 / std::sqrt(tukey_lambda_variance(lambda));
  const auto below = [&](double dn) { return tukey_lambda_cdf((dn - mean_dn) / scale, lambda); };
  ShownNoise out{.zero_share = below(0.5 * step_dn), .step_dn = step_dn, .samples = kSamples};
  double square = 0;
  for (int code = 1; code * step_dn < 40; ++code) {
    const double dn = code * step_dn, share = below(dn + 0.5 * step_dn) - below(dn - 0.5 * step_dn);
    out.mean_dn += share * dn;
    square += share * dn * dn;
  }
  out.variance_dn2 = square - out.mean_dn * out.mean_dn;
  return out;
}

TEST(CensoredNoise, IsTheLawThatShowsAsMuch) {
  for (const double step : {kFine, 0.3, 0.7})
    for (const double lambda : {0.3, kNormalLambda, 0.0, -0.1, -0.2})
      for (const double mean : {0.6, 0.2, 0.0, -0.3}) {
        const ShownNoise shown = shown_of(lambda, mean, step);
        if (shown.zero_share > kMostCensoredZeros) continue;
        const CensoredNoise found = find_censored_noise(shown);
        ASSERT_TRUE(found.known) << lambda << " " << mean << " " << step;
        EXPECT_NEAR(found.variance_dn2, 1, 0.006) << lambda << " " << mean << " " << step;
        EXPECT_NEAR(found.mean_dn, mean, 0.004) << lambda << " " << mean << " " << step;
        EXPECT_NEAR(found.lambda, lambda, 0.008) << lambda << " " << mean << " " << step;
        constexpr double kMoved = 0.01;
        const double slope =
            (shown_of(lambda, mean + kMoved, step).mean_dn - shown.mean_dn) / kMoved;
        EXPECT_NEAR(found.slope, slope, 0.03 * slope) << lambda << " " << mean << " " << step;
      }
}

TEST(CensoredNoise, IsNotKnownWhereTooLittleShows) {
  EXPECT_FALSE(find_censored_noise(shown_of(kNormalLambda, -0.9, kFine)).known);
  EXPECT_FALSE(find_censored_noise(shown_of(kNormalLambda, 0, 1.5)).known);
  EXPECT_FALSE(find_censored_noise({.mean_dn = 3, .variance_dn2 = 1, .step_dn = 1}).known);
}

// Of 40 draws of 20000 pixels the errors scatter as stated: the mean square of 40 has an error of
// 22 %. Level: four of it.
TEST(CensoredNoise, HasItsStandardErrors) {
  constexpr int kDraws = 40, kPixels = 20000;
  for (const double lambda : {kNormalLambda, -0.1}) {
    const double scale = 1.0 / std::sqrt(tukey_lambda_variance(lambda));
    double mean = 0, variance = 0, shape = 0;
    for (std::uint64_t seed = 0; seed < kDraws; ++seed) {
      RandomSequence random(seed, 0, Draw::kOther);
      ShownNoise shown{.step_dn = 0.2, .samples = kPixels};
      double square = 0;
      for (int i = 0; i < kPixels; ++i) {
        const double dn = scale * tukey_lambda_quantile(random.uniform(), lambda);
        const double code = std::max(std::round(dn / shown.step_dn) * shown.step_dn, 0.0);
        shown.zero_share += (code == 0) / double{kPixels};
        shown.mean_dn += code / kPixels;
        square += code * code / kPixels;
      }
      shown.variance_dn2 = square - shown.mean_dn * shown.mean_dn;
      const CensoredNoise found = find_censored_noise(shown);
      ASSERT_TRUE(found.known);
      mean += std::pow(found.mean_dn / found.mean_stderr_dn, 2) / kDraws;
      variance += std::pow((found.variance_dn2 - 1) / found.variance_stderr_dn2, 2) / kDraws;
      shape += std::pow((found.lambda - lambda) / found.lambda_stderr, 2) / kDraws;
    }
    for (const double square : {mean, variance, shape}) EXPECT_NEAR(square, 1, 0.9) << lambda;
  }
}

// Read noise had been 41 % too small, σ_b and DSNU half of what they are.
TEST(CensoredNoise, OfACameraWithoutABlackLevelIsKnown) {
  for (const double lambda : {kNormalLambda, -0.1}) {
    testing::SimulatedCamera camera = testing::mono_camera(1.0, lambda, 8.0, 0.8, 3);
    camera.rows = camera.cols = 128;
    camera.black_dn = 0;
    camera.dsnu_dn = 1;
    camera.flat_levels = 0;
    const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
    const double dark_dn = std::sqrt(64 + 0.64 + 1.0 / 12);
    EXPECT_TRUE(p.cut_off_undone && !p.dark_was_cut_off());
    EXPECT_GT(p.dark_zero_share.at(0), 0.45);
    EXPECT_NEAR(p.temporal_sd_dark_dn.at(0), dark_dn, 0.01 * dark_dn) << lambda;
    EXPECT_NEAR(p.temporal_sd_dark_dn[0], dark_dn, 4 * p.temporal_sd_dark_stderr_dn.at(0));
    EXPECT_NEAR(p.mu.mean.at(0), 0, 4 * p.mu.standard_error.at(0)) << lambda;
    EXPECT_NEAR(p.lambda.mean.at(0), lambda, 0.03);
    EXPECT_NEAR(p.sigma_tl.mean.at(0) * std::sqrt(tukey_lambda_variance(p.lambda.mean[0])), 8, 0.1);
    EXPECT_NEAR(p.sigma_row.mean.at(0), 0.8, 4 * p.sigma_row.standard_error.at(0)) << lambda;
    EXPECT_NEAR(p.dsnu_dn.at(0), 1, 4 * p.dsnu_stderr_dn.at(0)) << lambda;
  }
}

// K's line is fitted without the dark point that the law gives, and has an intercept; the report
// drew it through 0.
TEST(CensoredNoise, TheLineOfKIsNotThroughItsDarkPoint) {
  for (const double black_dn : {0.0, 13.0}) {
    testing::SimulatedCamera camera = testing::mono_camera(1.0, kNormalLambda, 8.0, 0.8, 3);
    camera.black_dn = black_dn;
    camera.flat_levels = 8;
    camera.flat_frames = 4;
    const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
    ASSERT_TRUE(p.cut_off_undone);
    ASSERT_EQ(p.K_intercept_dn2.size(), 1u);
    EXPECT_NE(p.K_intercept_dn2[0], 0);
    EXPECT_EQ(transfer_intercept_dn2(p, 0), black_dn == 0 ? p.K_intercept_dn2[0] : 0) << black_dn;
  }
}

}  // namespace
}  // namespace malus
