// Noise on noise: the deconvolution against Gaussians, and renoised frames against frames that were
// noisy at the target gain from the start.
#include "malus/synthesize/renoise.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/noise/distribution.h"
#include "malus/synthesize/compiled.h"

#include <cmath>
#include <numbers>

#include "sample_moments.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

std::vector<double> gaussian_bins(double sd, int bins, double width) {
  std::vector<double> p;
  const auto cdf = [sd](double x) { return 0.5 * std::erfc(-x / sd / std::numbers::sqrt2); };
  for (int b = 0; b < bins; ++b)
    p.push_back(cdf(width * (b + 1 - 0.5 * bins)) - cdf(width * (b - 0.5 * bins)));
  return p;
}

TEST(Deconvolve, GaussianFromGaussianLeavesTheDifferenceOfVariances) {
  const auto p1 = gaussian_bins(1.0, 121, 0.2), p2 = gaussian_bins(2.0, 121, 0.2);
  const auto d = deconvolve(p1, p2);
  ASSERT_EQ(d.size(), 241u);
  double total = 0, mean = 0, square = 0;
  for (std::size_t i = 0; i < d.size(); ++i) {
    const double x = 0.2 * (static_cast<double>(i) - 120);
    ASSERT_GE(d[i], 0);
    total += d[i];
    mean += d[i] * x;
    square += d[i] * x * x;
  }
  EXPECT_NEAR(total, 1, 1e-12);
  EXPECT_NEAR(mean, 0, 1e-6);
  EXPECT_NEAR(square, 3.0, 0.02);
  for (std::size_t k = 0; k < 121; ++k) {  // p1 * d
    double sum = 0;
    for (std::size_t j = 0; j < 121; ++j) sum += p1[j] * d[k + 120 - j];
    EXPECT_NEAR(sum, p2[k], 2e-4);
  }
}

TEST(Deconvolve, EqualDistributionsNeedNoChange) {
  const auto p = gaussian_bins(0.7, 41, 0.5);
  const auto d = deconvolve(p, p, 2000);
  EXPECT_GT(d[40] + d[39] + d[41], 0.97);
}

PhysicsNoise mono(double K, double sigma_tl, double sigma_row, double mu) {
  PhysicsNoise noise;
  noise.layout = SensorLayout::named("mono");
  noise.channels = {{.gain_dn_per_e = K,
                     .lambda = 0.05,
                     .mu_dn = mu,
                     .sigma_tl_dn = sigma_tl,
                     .sigma_row_dn = sigma_row}};
  return noise;
}

TEST(PixelBins, AgreeWithTheNumericDistribution) {
  const PhysicsNoise noise = mono(2.0, 0.8, 0, -1);
  const PixelDistribution truth(noise.channels[0], noise.parts, 1.0, 30.0);
  const auto p = PixelBins(noise, 0).probabilities(30.0, 0.7, 101);
  double total = 0;
  for (int b = 1; b < 100; ++b) {
    const double low = 30.0 + 0.7 * (b - 50.5);
    EXPECT_NEAR(p[static_cast<std::size_t>(b)], truth.cdf(low + 0.7) - truth.cdf(low), 2e-5);
  }
  for (const double v : p) total += v;
  EXPECT_NEAR(total, 1, 1e-12);
}

TEST(Renoiser, GivesTheTargetsMomentsAtEveryLevel) {
  const PhysicsNoise from = mono(0.5, 0.6, 0.2, -1), to = mono(2.0, 1.5, 0.7, -3);
  const Renoiser renoiser(from, to, 2000);
  const CompiledNoise source(from);
  for (const double level : {0.0, 7.0, 150.0, 1900.0}) {
    const Image clean(500, 600, static_cast<float>(level));
    Image noisy(500, 600), again(500, 600);
    source.apply(clean.view(), noisy.view(), {.seed = 1, .frame = 0});
    // The same seed and number as the source: the noises must be independent all the same.
    renoiser.apply(noisy, clean, again, {.seed = 1, .frame = 0});
    const Moments m = testing::moments_of(again);
    const PixelDistribution truth(to.channels[0], to.parts, 1.0, level);
    const double row_variance = 0.49, variance = truth.variance_dn2() + row_variance;
    // The rows' 500 draws bound the mean; 1 % for bins and the end of the iteration.
    EXPECT_NEAR(m.mean(), level - 3,
                5 * std::sqrt(truth.variance_dn2() / 3e5 + row_variance / 500) +
                    0.002 * truth.variance_dn2() / 2);
    EXPECT_NEAR(
        m.variance() / variance, 1.0,
        5 * std::sqrt(2.0 / 3e5) + 5 * row_variance / variance * std::sqrt(2.0 / 500) + 0.01)
        << level;
  }
}

// Rows of the target's autocorrelation, whatever the source's: 40 frames of 400 row means; the
// error of a covariance of drifting rows is below 2.5 times that of white ones.
TEST(Renoiser, RowsGetTheTargetsDrift) {
  PhysicsNoise from = mono(0.5, 0.6, 0.5, 0), to = mono(2.0, 1.5, 1.5, 0);
  from.row_drift = {0.3, 2.0};
  to.row_drift = {0.6, 4.0};
  const Renoiser renoiser(from, to, 2000);
  const CompiledNoise source(from);
  const Image clean(400, 64, 0.0f);
  Image noisy(400, 64), again(400, 64);
  Moments lagged[3];
  for (std::uint32_t frame = 0; frame < 40; ++frame) {
    source.apply(clean.view(), noisy.view(), {.seed = 2, .frame = frame});
    renoiser.apply(noisy, clean, again, {.seed = 2, .frame = frame});
    std::vector<double> mean(400, 0.0);
    for (int r = 0; r < 400; ++r)
      for (int c = 0; c < 64; ++c) mean[static_cast<std::size_t>(r)] += double{again(r, c)} / 64;
    for (std::size_t lag = 1; lag <= 3; ++lag)
      for (std::size_t r = lag; r < 400; ++r) lagged[lag - 1].add(mean[r] * mean[r - lag]);
  }
  // The source's slow part keeps its shorter length: the sum is the target's at lag 1 only nearly.
  const double slow_from = 0.25 * 0.3, slow_added = 2.25 * 0.6 - slow_from;
  for (int lag = 1; lag <= 3; ++lag) {
    const Moments& m = lagged[lag - 1];
    const double error = 2.5 * std::sqrt(m.variance() / static_cast<double>(m.count()));
    EXPECT_NEAR(m.mean(), slow_from * std::exp(-lag / 2.0) + slow_added * std::exp(-lag / 4.0),
                4 * error)
        << lag;
  }
}

// A guide that lost all detail: noise on noise keeps the detail of the noisy frame, the naive
// scheme (guide + new noise) has lost it.
TEST(Renoiser, KeepsDetailThatTheGuideLost) {
  const PhysicsNoise from = mono(0.5, 0.6, 0, 0), to = mono(1.0, 1.2, 0, 0);
  const Renoiser renoiser(from, to, 2000);
  Image clean(300, 400), guide(300, 400, 500.0f), noisy(300, 400), ours(300, 400), naive(300, 400);
  for (int r = 0; r < 300; ++r)
    for (int c = 0; c < 400; ++c) clean(r, c) = (r + c) % 2 != 0 ? 480.0f : 520.0f;
  CompiledNoise(from).apply(clean.view(), noisy.view(), {.seed = 2});
  renoiser.apply(noisy, guide, ours, {.seed = 3});
  CompiledNoise(to).apply(guide.view(), naive.view(), {.seed = 3});
  double detail = 0, naive_detail = 0;
  for (int r = 0; r < 300; ++r)
    for (int c = 0; c < 400; ++c) {
      const double sign = (r + c) % 2 != 0 ? -1 : 1;
      detail += sign * static_cast<double>(ours(r, c));
      naive_detail += sign * static_cast<double>(naive(r, c));
    }
  const double error = 5 * std::sqrt(502.0 / 120000);
  EXPECT_NEAR(detail / 120000, 20.0, error);
  EXPECT_NEAR(naive_detail / 120000, 0.0, error);
}

TEST(Renoiser, QuieterTargetsAreRefused) {
  EXPECT_THROW(Renoiser(mono(2.0, 1.0, 0, 0), mono(0.5, 0.5, 0, 0), 1000), InputError);
}

}  // namespace
}  // namespace malus
