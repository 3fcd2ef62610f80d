// Truth: moments of stabilised samples by simulation from the generative law, not from the tables.
#include "malus/noise/stabilize.h"

#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/noise/distribution.h"
#include "malus/noise/tukey_lambda.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

struct Law {
  double slope, read_deviation;
};

// One sample of K Poisson(s/K) + N(0, read), by inversion and one normal.
double sample(const Law& law, double s, RandomSequence& random) {
  double value = law.read_deviation * random.normal();
  if (law.slope <= 0) return s + value;
  const double electrons = s / law.slope, u = random.uniform();
  double probability = std::exp(-electrons), below = probability;
  int n = 0;
  while (u > below && n < 2000) {
    probability *= electrons / ++n;
    below += probability;
  }
  return law.slope * n + value;
}

TEST(Stabilizer, DeviationIsOneAndTheInverseIsUnbiased) {
  constexpr int kSamples = 40000;
  for (const Law& law : {Law{1.55, 3.7}, Law{6.2, 15.0}, Law{0.4, 0.9}, Law{0.0, 2.0}}) {
    const Stabilizer stabilizer(
        VarianceCurve::affine(law.slope, law.read_deviation * law.read_deviation), 4013);
    for (const double s : {0.0, 2.0, 10.0, 60.0, 250.0}) {
      RandomSequence random(7, static_cast<std::uint32_t>(s), Draw::kUser);
      Moments moments;
      for (int i = 0; i < kSamples; ++i) moments.add(stabilizer.forward(sample(law, s, random)));
      const double deviation = std::sqrt(moments.variance());
      EXPECT_NEAR(deviation, 1.0, s < 3 * law.slope ? 0.08 : 0.04) << law.slope << " at " << s;
      // Five standard errors of the mean, in DN.
      const double local = std::sqrt(law.slope * s + law.read_deviation * law.read_deviation +
                                     0.4 * law.slope * law.slope);
      EXPECT_NEAR(stabilizer.inverse(moments.mean()), s, 5 * local / std::sqrt(kSamples))
          << law.slope << " at " << s;
    }
  }
}

TEST(Stabilizer, AMeasuredCurveAgreesWithTheAffineOneItSamples) {
  std::vector<double> signal, variance;
  for (double s = 0; s <= 4500; s += 10) {
    signal.push_back(s);
    variance.push_back(1.55 * s + 13.7);
  }
  const Stabilizer exact(VarianceCurve::affine(1.55, 13.7), 4013);
  const Stabilizer measured(VarianceCurve::table(signal, variance), 4013);
  for (double s = -10; s < 4000; s += 37) {
    EXPECT_NEAR(measured.forward(s), exact.forward(s), 2e-3);
    if (s > 100) {
      EXPECT_NEAR(measured.inverse(exact.forward(s)), exact.inverse(exact.forward(s)), 0.02) << s;
    }
  }
}

// Read noise with heavy tails (Tukey-lambda, lambda -0.2; Gaussian is 0.14), of which the
// stabiliser knows the variance only; affine and tabulated curves. The truth is the numerical
// distribution.
TEST(Stabilizer, HeavyTailsBiasTheInverseByLessThanTwoHundredths) {
  for (const double lambda : {-0.2, 0.14, 0.5})
    for (const double K : {0.4, 1.55, 6.2})
      for (const double read_e : {1.0, 2.4}) {
        const double deviation = read_e * K;
        const PhysicsChannel channel{
            .gain_dn_per_e = K,
            .lambda = lambda,
            .mu_dn = 0,
            .sigma_tl_dn = deviation / std::sqrt(tukey_lambda_variance(lambda)),
            .sigma_row_dn = 0};
        const double offset = deviation * deviation + 1.0 / 12;
        std::vector<double> signal, variance;
        for (double s = 0; s <= 4100; s += 4) {
          signal.push_back(s);
          variance.push_back(K * s + offset);
        }
        const Stabilizer affine(VarianceCurve::affine(K, offset), 4013);
        const Stabilizer measured(VarianceCurve::table(signal, variance), 4013);
        for (const double electrons : {0.0, 0.5, 2.0, 5.0, 20.0, 100.0}) {
          const double s = electrons * K, local = std::sqrt(K * s + offset);
          const PixelDistribution law(channel, PhysicsParts{}, 1.0, s);
          for (const Stabilizer* stabilizer : {&affine, &measured}) {
            const double mean = law.expectation([&](double x) { return stabilizer->forward(x); });
            EXPECT_NEAR(stabilizer->inverse(mean), s, 0.02 * local)
                << lambda << ", " << K << " DN/e-, " << electrons << " electrons";
          }
        }
      }
}

TEST(Stabilizer, MeanOfIsTheInversesInverse) {
  for (const Law& law : {Law{1.55, 3.7}, Law{0.4, 0.9}, Law{0.0, 2.0}}) {
    const Stabilizer stabilizer(
        VarianceCurve::affine(law.slope, law.read_deviation * law.read_deviation), 4013);
    for (double s = -100; s < 6000; s += 23)
      EXPECT_NEAR(stabilizer.inverse(stabilizer.mean_of(s)), s, 1e-8 * (100 + std::abs(s))) << s;
  }
}

TEST(Stabilizer, BothDirectionsRiseAndSurviveExtremes) {
  const Stabilizer stabilizer(VarianceCurve::affine(1.55, 13.7), 4013);
  double last_forward = -1e30, last_inverse = -1e30;
  for (double x = -500; x < 9000; x += 3.7) {
    EXPECT_GT(stabilizer.forward(x), last_forward);
    last_forward = stabilizer.forward(x);
  }
  for (double x = -100; x < 300; x += 0.31) {
    EXPECT_GT(stabilizer.inverse(x), last_inverse);
    last_inverse = stabilizer.inverse(x);
    EXPECT_GT(stabilizer.inverse_slope(x), 0);
  }
  const Stabilizer noiseless(VarianceCurve::affine(0, 0), 1000);
  EXPECT_NEAR(noiseless.inverse(noiseless.forward(417.25)), 417.25, 0.01);
}

}  // namespace
}  // namespace malus
