#include "malus/noise/residual_law.h"

#include "malus/noise/tukey_lambda.h"

#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

// Codes of a pixel whose offset lies anywhere between two of them, less a wrong offset.
std::vector<double> residuals(double lambda, double scale_dn, const ResidualBlurring& blur) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> error(0, std::sqrt(blur.offset_variance_dn2));
  std::vector<double> made(400000);
  for (double& r : made) {
    const double offset = blur.step_dn * uniform(random);
    const double noise = scale_dn * tukey_lambda_quantile(uniform(random), lambda);
    r = blur.step_dn * std::round((offset + noise) / blur.step_dn) - offset + error(random);
  }
  return made;
}

TEST(ResidualLaw, IsThatOfRoundedNoiseAboutAnUncertainOffset) {
  for (const double lambda : {-0.2, 0.0, kNormalLambda, 0.8})
    for (const double scale_dn : {0.1, 0.3, 2.0}) {
      const double deviation_dn = tukey_lambda_deviation(scale_dn, lambda);
      const ResidualBlurring blur{1.0, 0.05 * deviation_dn * deviation_dn};
      const ResidualLaw law = ResidualLaw::tukey(lambda, scale_dn, blur);
      const std::vector<double> drawn = residuals(lambda, scale_dn, blur);
      for (const double r : {0.1, 0.5, 0.9, 1.4, 3.0}) {
        const double share = law.above(r);
        double counted = 0;
        for (const double value : drawn) counted += value > r ? 1 : 0;
        const auto n = static_cast<double>(drawn.size());
        // Five points stand for the offset's error: of an abrupt law they leave small steps.
        const double slack = lambda > 0.5 ? 0.004 : 0;
        EXPECT_NEAR(counted / n, share, 5 * std::sqrt(share * (1 - share) / n) + 1e-5 + slack)
            << lambda << " " << scale_dn << " " << r;
      }
    }
}

TEST(ResidualLaw, WithoutAStepIsTheLawItself) {
  const ResidualLaw tukey = ResidualLaw::tukey(0.3, 2.0, {0, 0}),
                    normal = ResidualLaw::normal(2.0, {0, 0});
  for (const double r : {-3.0, 0.0, 0.7, 4.0}) {
    EXPECT_NEAR(tukey.above(r), 1 - tukey_lambda_cdf(r / 2, 0.3), 1e-6) << r;
    EXPECT_NEAR(tukey.density(r, 0.01), tukey_lambda_pdf(r / 2, 0.3) / 2, 1e-5) << r;
    EXPECT_NEAR(normal.above(r), 0.5 * std::erfc(r / 2 / std::sqrt(2.0)), 1e-6) << r;
  }
  EXPECT_NEAR(normal.above(16) / (0.5 * std::erfc(8 / std::sqrt(2.0))), 1, 1e-4);
}

TEST(ResidualLaw, IsSymmetricAndItsBinsAddUp) {
  const ResidualLaw law = ResidualLaw::tukey(0.14, 0.3, {1.0, 0.01});
  EXPECT_NEAR(law.above(0), 0.5, 1e-12);
  double total = 0;
  for (int i = -40; i <= 40; ++i) total += 0.25 * law.density(0.25 * i, 0.25);
  EXPECT_NEAR(total, 1, 1e-9);
  EXPECT_EQ(law.density(0.7, 0.25), law.density(-0.7, 0.25));
}

}  // namespace
}  // namespace malus
