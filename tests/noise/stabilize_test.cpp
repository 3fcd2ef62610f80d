// Truth: moments of stabilised samples by simulation from the generative law or by sums over it,
// not from the tables.
#include "malus/noise/stabilize.h"

#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/noise/distribution.h"
#include "malus/noise/model.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "pixel_expectation.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::expectation_of;

struct AffineLaw {
  double slope, read_deviation;
};

// One sample of K Poisson(s/K) + N(0, read), by inversion and one normal.
double sample(const AffineLaw& law, double s, RandomSequence& random) {
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
  for (const AffineLaw& law :
       {AffineLaw{1.55, 3.7}, AffineLaw{6.2, 15.0}, AffineLaw{0.4, 0.9}, AffineLaw{0.0, 2.0}}) {
    const Stabilizer stabilizer(
        VarianceCurve::affine(law.slope, law.read_deviation * law.read_deviation), 4013);
    for (const double s : {0.0, 2.0, 10.0, 60.0, 250.0}) {
      RandomSequence random(7, static_cast<std::uint32_t>(s), Draw::kOther);
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

// Less than 1 in the dark; of a curve that is a multiple of the law's, the law's own share.
TEST(StabilizedVariance, IsThatOfSamples) {
  constexpr int kSamples = 40000;
  for (const AffineLaw& law : {AffineLaw{2.0, 1.4}, AffineLaw{1.55, 3.7}, AffineLaw{0.0, 2.0}})
    for (const double factor : {1.0, 1.44}) {
      const VarianceCurve curve =
          VarianceCurve::affine(law.slope, law.read_deviation * law.read_deviation);
      const Stabilizer stabilizer(curve.scaled(factor), 4013, NoiseLaw::gaussian(curve));
      const StabilizedVariance variance(stabilizer, 4013, NoiseLaw::gaussian(curve));
      for (const double s : {0.0, 0.4, 2.0, 10.0, 250.0, 600.0}) {
        RandomSequence random(8, static_cast<std::uint32_t>(10 * s), Draw::kOther);
        Moments moments;
        for (int i = 0; i < kSamples; ++i) moments.add(stabilizer.forward(sample(law, s, random)));
        // Five standard errors.
        EXPECT_NEAR(variance.at(stabilizer.mean_of(s)) / moments.variance(), 1.0,
                    5 * std::sqrt(2.0 / kSamples))
            << law.slope << " at " << s;
      }
      EXPECT_EQ(variance.at(-3), variance.at(stabilizer.mean_of(0)));
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

// Places in the table that no integer counts: the curve fell back to its first cell's slope.
TEST(Stabilizer, AMeasuredCurveGoesOnStraightHoweverFar) {
  const Stabilizer measured(VarianceCurve::table({0, 1000, 4000}, {10, 1500, 6000}), 4013);
  const double slope = measured.forward(1e9) / 1e9;
  for (const double far : {1e12, 1e18, 1e20, 1e25, 1e37})
    EXPECT_NEAR(measured.forward(far) / far, slope, 1e-4 * slope) << far;
  EXPECT_TRUE(std::isnan(measured.forward(std::nan(""))));
}

// Read noise with other tails than a Gaussian's (Tukey-lambda; Gaussian is 0.14). The truth is the
// numerical distribution of one pixel. With the model's own law the inverse is unbiased; with the
// variance alone heavy tails cost up to 0.019 deviations.
TEST(Stabilizer, TheInverseIsUnbiasedForTukeyLambdaReadNoise) {
  double worst_own = 0, worst_gaussian = 0;
  for (const double lambda : {-0.4, -0.2, 0.14, 0.5})
    for (const double K : {0.05, 0.4, 1.55, 6.2})
      for (const double read_e : {1.0, 2.4, 9.0}) {
        const double deviation = read_e * K;
        const PhysicsChannel channel{
            .gain_dn_per_e = K,
            .lambda = lambda,
            .mu_dn = 0,
            .sigma_tl_dn = deviation / std::sqrt(tukey_lambda_variance(lambda)),
            .sigma_row_dn = 0};
        const double offset = deviation * deviation + 1.0 / 12;
        const VarianceCurve curve = VarianceCurve::affine(K, offset);
        const NoiseLaw law = NoiseLaw::physics(channel, PhysicsParts{}, 1.0);
        const Stabilizer own(curve, 4013, law), gaussian(curve, 4013);
        // A stronger denoising changes the curve, not the noise.
        const Stabilizer stronger(curve.scaled(2.0), 4013, law);
        for (const double electrons : {0.0, 0.5, 2.0, 5.0, 20.0, 59.0, 61.0, 150.0}) {
          const double s = electrons * K, local = std::sqrt(K * s + offset);
          const PixelDistribution pixel(channel, PhysicsParts{}, 1.0, s);
          const auto bias = [&](const Stabilizer& stabilizer) {
            const double mean =
                expectation_of([&](double x) { return stabilizer.forward(x); }, pixel);
            return std::abs(stabilizer.inverse(mean) - s) / local;
          };
          EXPECT_LT(bias(own), 1e-3)
              << lambda << ", " << K << " DN/e-, " << read_e << " e-, " << electrons;
          EXPECT_LT(bias(stronger), 1e-3)
              << lambda << ", " << K << " DN/e-, " << read_e << " e-, " << electrons;
          worst_own = std::max(worst_own, bias(own));
          if (lambda > -0.3 && K > 0.1) worst_gaussian = std::max(worst_gaussian, bias(gaussian));
        }
      }
  EXPECT_LT(worst_own, 0.2 * worst_gaussian);
  EXPECT_LT(worst_gaussian, 0.02);
}

// Where it is bright the expectation is worked out at few knots; here at every signal by itself.
TEST(Stabilizer, BrightSignalsHaveTheLawsExpectation) {
  for (const double K : {0.05, 0.4, 6.2}) {
    const PhysicsChannel channel{
        .gain_dn_per_e = K, .lambda = -0.2, .mu_dn = 0, .sigma_tl_dn = 2 * K, .sigma_row_dn = 0};
    const NoiseLaw law = NoiseLaw::physics(channel, PhysicsParts{}, 1.0);
    const double read_dn2 = 4 * K * K * tukey_lambda_variance(-0.2) + 1.0 / 12;
    const Stabilizer stabilizer(VarianceCurve::affine(K, read_dn2), 4013, law);
    for (double s = 100 * K; s < 4000; s *= 1.013) {
      const auto curve = [&](double dn) { return stabilizer.forward(dn); };
      EXPECT_NEAR(stabilizer.mean_of(s), law.expectations(curve, {s}).front(), 3e-5)
          << K << " " << s;
    }
  }
}

// A measured, skewed distribution: shifted gamma-like bins at three levels. The truth is summed
// over a hundred points in every bin.
TEST(Stabilizer, TheInverseIsUnbiasedForMeasuredDistributions) {
  NonparametricChannel channel;
  channel.level_dn = {2, 40, 300};
  for (double edge = -20; edge <= 120; edge += 1.25) channel.bin_edges_dn.push_back(edge);
  for (const double spread : {4.0, 8.0, 18.0}) {
    std::vector<double> pmf;
    double total = 0;
    for (std::size_t b = 0; b + 1 < channel.bin_edges_dn.size(); ++b) {
      const double x =
          (0.5 * (channel.bin_edges_dn[b] + channel.bin_edges_dn[b + 1]) + 18) / spread;
      pmf.push_back(x > 0 ? x * std::exp(-1.5 * x) : 0.0);
      total += pmf.back();
    }
    for (double& p : pmf) p /= total;
    channel.pmf.push_back(pmf);
    channel.samples.push_back(1000000);
  }
  std::vector<double> variance;
  for (std::size_t level = 0; level < 3; ++level)
    variance.push_back(level_moments(channel, level).variance_dn2);
  const double bias = level_moments(channel, 0).mean_dn;
  const VarianceCurve curve = VarianceCurve::table(channel.level_dn, variance);
  const Stabilizer own(curve, 1000, NoiseLaw::measured(channel, bias));
  const auto mean_at = [&](std::size_t level, double s) {
    double sum = 0;
    for (std::size_t b = 0; b < channel.pmf[level].size(); ++b)
      for (int i = 0; i < 100; ++i)
        sum += channel.pmf[level][b] / 100 *
               own.forward(s - bias + channel.bin_edges_dn[b] + 1.25 * (i + 0.5) / 100);
    return sum;
  };
  for (const double s : {0.0, 2.0, 10.0, 21.0, 40.0, 170.0, 300.0, 500.0}) {
    const double t = std::clamp(s < 40 ? (s - 2) / 38 : (s - 40) / 260, 0.0, 1.0);
    const std::size_t below = s < 40 ? 0 : 1;
    const double mean = (1 - t) * mean_at(below, s) + t * mean_at(below + 1, s);
    EXPECT_NEAR(own.inverse(mean), s, 2e-3 * std::sqrt(curve(s))) << s;
  }
}

// PRNU of 5 % has 1.25 times the shot noise's variance at 500 electrons, DSNU of 3 electrons 2.25
// times the read noise's in the dark.
TEST(Stabilizer, DeviationIsOneAndTheInverseUnbiasedOfPixelsThatDiffer) {
  constexpr int kSamples = 40000;
  constexpr double kPrnu = 0.05, kDsnu = 1.5, K = 0.5, kRead = 1.0;
  const VarianceCurve curve = VarianceCurve::affine(K, kRead * kRead).with_pattern(kPrnu, kDsnu);
  const Stabilizer stabilizer(curve, 4000);
  for (const double s : {0.0, 10.0, 60.0, 250.0}) {
    RandomSequence random(8, static_cast<std::uint32_t>(s), Draw::kOther);
    Moments moments;
    for (int i = 0; i < kSamples; ++i) {
      const double own = s * (1 + kPrnu * random.normal()), dark = kDsnu * random.normal();
      moments.add(stabilizer.forward(sample({K, kRead}, own, random) + dark));
    }
    EXPECT_NEAR(std::sqrt(moments.variance()), 1.0, s > 0 ? 0.03 : 0.08) << s;
    EXPECT_NEAR(stabilizer.inverse(moments.mean()), s, 5 * std::sqrt(curve(s) / kSamples)) << s;
  }
}

TEST(Stabilizer, MeanOfIsTheInversesInverse) {
  for (const AffineLaw& law : {AffineLaw{1.55, 3.7}, AffineLaw{0.4, 0.9}, AffineLaw{0.0, 2.0}}) {
    const Stabilizer stabilizer(
        VarianceCurve::affine(law.slope, law.read_deviation * law.read_deviation), 4013);
    for (double s = -100; s < 6000; s += 23)
      EXPECT_NEAR(stabilizer.inverse(stabilizer.mean_of(s)), s, 1e-8 * (100 + std::abs(s))) << s;
  }
}

double stabilized_deviation(const Stabilizer& stabilizer, double signal_dn, double deviation_dn) {
  RandomSequence random(9, 0, Draw::kOther);
  Moments moments;
  for (int i = 0; i < 20000; ++i)
    moments.add(stabilizer.forward(signal_dn + deviation_dn * random.normal()));
  return std::sqrt(moments.variance());
}

// White is that of the container where the camera's own is not known: far above all signals.
TEST(Stabilizer, AWhiteThatIsFarAwayLeavesTheNoiseOfTheDark) {
  for (const double slope : {0.0, 1e-4, 0.02}) {
    const Stabilizer stabilizer(VarianceCurve::affine(slope, 0.49), 65535);
    for (const double s : {-3.0, 0.0, 5.0})
      EXPECT_NEAR(stabilized_deviation(stabilizer, s, std::sqrt(0.49 + slope * std::max(s, 0.0))),
                  1.0, 0.03)
          << slope << " at " << s;
    EXPECT_NEAR(stabilizer.inverse(stabilizer.mean_of(20.0)), 20.0, 1e-6);
  }
}

// A line fitted to bright levels alone, or to pixels that hold an unknown black level.
TEST(Stabilizer, DeviationIsOneWhereTheLineBeginsAboveTheDark) {
  NoiseModel model;
  model.layout = SensorLayout::named("mono");
  GaussianCalibration line;
  line.gain.gain_db = 0;
  line.slope_dn = {0.5};
  line.offset_dn2 = {-40};
  model.gaussian.push_back(line);
  const NoiseProfile profile = model.profile_at(line.gain);
  const Stabilizer stabilizer(profile.channels[0].variance, 4095);
  for (const double s : {90.0, 100.0, 400.0}) {
    const double deviation = std::sqrt(0.5 * s - 40);
    EXPECT_NEAR(stabilized_deviation(stabilizer, s, deviation), 1.0, 0.04) << s;
    EXPECT_NEAR(stabilizer.inverse(stabilizer.mean_of(s)), s, 1e-6);
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
