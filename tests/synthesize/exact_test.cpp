// The plain definition against closed forms: cumulants of Poisson, Tukey-lambda and uniform add.
#include "malus/synthesize/exact.h"

#include "malus/base/chi_square.h"
#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/noise/tukey_lambda.h"
#include "malus/synthesize/internal/poisson.h"

#include <cmath>
#include <limits>
#include <numeric>

#include "sample_moments.h"
#include "sixteen_channels.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::kSigmas;
using testing::moments_of;
using testing::mono_noise;

TEST(ExactNoise, MeanAndVarianceFollowTheFormula) {
  for (const double signal : {0.0, 0.7, 12.0, 400.0, 3500.0}) {
    const PhysicsNoise noise = mono_noise({0.8, 0.1, -3.0, 1.5, 0.0});
    const Image clean(500, 400, static_cast<float>(signal));
    Image noisy(500, 400);
    add_noise_exact(noise, clean, noisy, {.seed = 1, .frame = 2});
    const Moments m = moments_of(noisy);
    const double variance = 0.8 * static_cast<double>(static_cast<float>(signal)) +
                            1.5 * 1.5 * tukey_lambda_variance(0.1) + 1.0 / 12.0;
    EXPECT_NEAR(m.mean(), signal - 3.0, kSigmas * std::sqrt(variance / 2e5)) << signal;
    EXPECT_NEAR(m.variance(), variance, kSigmas * m.variance_standard_error()) << signal;
  }
}

TEST(ExactNoise, PoissonCumulantsBothAlgorithms) {
  // Skewness 1/sqrt(m) and excess kurtosis 1/m below and above the switch of algorithms. The error
  // of a mean cube or fourth power is known from the drawn ones.
  for (const double mean : {0.3, 4.0, 9.99, 10.01, 50.0}) {
    constexpr int kDraws = 300000;
    Moments m, cubes, fourths;
    for (std::uint32_t i = 0; i < kDraws; ++i) {
      RandomSequence sequence(3, i, Draw::kOther);
      const auto uniforms = [&] { return sequence.uniform(); };
      const double drawn = poisson_draw(mean, uniforms);
      m.add(drawn);
      cubes.add(std::pow((drawn - mean) / std::sqrt(mean), 3));
      fourths.add(std::pow((drawn - mean) / std::sqrt(mean), 4));
    }
    EXPECT_NEAR(m.mean(), mean, kSigmas * std::sqrt(mean / kDraws));
    EXPECT_NEAR(m.variance(), mean, kSigmas * m.variance_standard_error());
    EXPECT_NEAR(cubes.mean(), 1 / std::sqrt(mean), kSigmas * std::sqrt(cubes.variance() / kDraws));
    EXPECT_NEAR(fourths.mean(), 3 + 1 / mean, kSigmas * std::sqrt(fourths.variance() / kDraws));
  }
}

// Numbers of few expected draws share a cell; χ² that chance exceeds once in 10,000.
TEST(ExactNoise, PoissonProbabilitiesChiSquare) {
  for (const double mean : {6.0, 13.7}) {
    constexpr int kDraws = 200000, kNumbers = 40;
    std::vector<double> counts(kNumbers, 0.0);
    for (std::uint32_t i = 0; i < kDraws; ++i) {
      RandomSequence sequence(4, i, Draw::kOther);
      const auto uniforms = [&] { return sequence.uniform(); };
      counts[std::min<std::size_t>(kNumbers - 1,
                                   static_cast<std::size_t>(poisson_draw(mean, uniforms)))] += 1;
    }
    double chi2 = 0, left = kDraws, expected = 0, drawn = 0;
    int cells = 0;
    for (int k = 0; k < kNumbers; ++k) {
      expected += kDraws * std::exp(-mean + k * std::log(mean) - std::lgamma(k + 1.0));
      drawn += counts[static_cast<std::size_t>(k)];
      const double beyond = left - expected;
      if (beyond < 5) {  // the last cell takes all that lies beyond it
        drawn += std::accumulate(counts.begin() + k + 1, counts.end(), 0.0);
        expected = left;
      } else if (expected < 5) {
        continue;
      }
      chi2 += (drawn - expected) * (drawn - expected) / expected;
      ++cells;
      if (beyond < 5) break;
      left = beyond;
      expected = drawn = 0;
    }
    const double freedom = cells - 1;
    EXPECT_GT(freedom, 15);
    EXPECT_LT(chi2, freedom * chi_square_ratio(3.719, freedom)) << mean;
  }
}

TEST(ExactNoise, EverySwitchRemovesItsPartOnly) {
  PhysicsNoise noise = mono_noise({1.0, 0.1, 5.0, 2.0, 3.0});
  noise.parts = {.shot = false, .read = false, .row = false, .quantization = false, .bias = false};
  const Image clean(64, 64, 100.5f);
  Image noisy(64, 64);
  add_noise_exact(noise, clean, noisy, {});
  EXPECT_EQ(noisy.values(), clean.values());

  noise.parts.bias = true;
  add_noise_exact(noise, clean, noisy, {});
  for (const float v : noisy.values()) ASSERT_EQ(v, 105.5f);

  noise.parts = {.shot = true, .read = false, .row = false, .quantization = false, .bias = false};
  add_noise_exact(noise, clean, noisy, {});
  for (const float v : noisy.values()) ASSERT_EQ(v, std::floor(v));  // K = 1: whole electrons

  noise.parts = {.shot = false, .read = false, .row = false, .quantization = true, .bias = false};
  add_noise_exact(noise, clean, noisy, {});
  for (const float v : noisy.values()) ASSERT_LE(std::abs(v - 100.5f), 0.5f);

  noise.parts = {.shot = false, .read = false, .row = true, .quantization = false, .bias = false};
  add_noise_exact(noise, clean, noisy, {});
  for (int r = 0; r < 64; ++r)
    for (int c = 1; c < 64; ++c) ASSERT_EQ(noisy(r, c), noisy(r, 0));
  EXPECT_NE(noisy(0, 0), noisy(1, 0));
}

TEST(ExactNoise, RowGroupsShareOneDrawScaledPerChannel) {
  PhysicsNoise noise;
  noise.layout = SensorLayout::named("polar-bayer-rggb");
  for (int c = 0; c < 16; ++c)
    noise.channels.push_back({.gain_dn_per_e = 1, .sigma_row_dn = 0.5 + 0.1 * c});
  noise.row_group = 2;
  noise.parts = {.shot = false, .read = false, .row = true, .quantization = false, .bias = false};
  const Image clean(400, 8);
  Image noisy(400, 8);
  add_noise_exact(noise, clean, noisy, {.seed = 9});
  Moments z;
  for (int r = 0; r < 400; r += 2) {
    const double draw = static_cast<double>(noisy(r, 0)) /
                        noise.channels[noise.layout.channel_at(r, 0)].sigma_row_dn;
    z.add(draw);
    for (int dr = 0; dr < 2; ++dr)
      for (int c = 0; c < 8; ++c) {
        const int channel = noise.layout.channel_at(r + dr, c);
        ASSERT_NEAR(static_cast<double>(noisy(r + dr, c)),
                    draw * noise.channels[static_cast<std::size_t>(channel)].sigma_row_dn, 1e-5);
      }
  }
  EXPECT_NEAR(z.mean(), 0, kSigmas / std::sqrt(200));
  EXPECT_NEAR(z.variance(), 1, kSigmas * z.variance_standard_error());
}

TEST(RowDeviates, WhiteOnesAreTheGroupsDraws) {
  const DrawAddress place{.seed = 21, .frame = 4, .row0 = 7};
  const auto z = row_deviates(place, 12, 2, {});
  for (int r = 0; r < 12; ++r)
    EXPECT_EQ(z[static_cast<std::size_t>(r)], row_group_draw(place, (7 + r) / 2));
}

TEST(RowDeviates, DependOnTheirPlaceAndNotOnTheWindow) {
  const RowDrift drift{0.5, 20.0};
  const auto all = row_deviates({.seed = 22, .frame = 1}, 500, 2, drift);
  for (const int row0 : {0, 1, 7, 211, 499})
    for (const int rows : {1, 2, 5, 130})
      if (row0 + rows <= 500) {
        const auto window = row_deviates({.seed = 22, .frame = 1, .row0 = row0}, rows, 2, drift);
        for (int r = 0; r < rows; ++r)
          ASSERT_EQ(window[static_cast<std::size_t>(r)], all[static_cast<std::size_t>(row0 + r)]);
      }
  EXPECT_TRUE(row_deviates({.seed = 22}, 0, 2, drift).empty());
}

// Over many frames, from the first row of a frame on: unit variance, and the stated correlation.
TEST(RowDeviates, HaveTheStatedAutocorrelation) {
  for (const RowDrift drift : {RowDrift{0.33, 2.0}, RowDrift{1.0, 6.0}, RowDrift{0.1, 30.0}}) {
    constexpr int kFrames = 40000;
    for (const int lag : {0, 1, 2, 5, 12}) {
      Moments product;
      for (std::uint32_t f = 0; f < kFrames; ++f) {
        const auto z = row_deviates({.seed = 23, .frame = f}, 13, 1, drift);
        product.add(z[0] * z[static_cast<std::size_t>(lag)]);
      }
      EXPECT_NEAR(product.mean(), row_autocorrelation(drift, lag),
                  kSigmas * std::sqrt(product.variance() / kFrames))
          << drift.share << ' ' << lag;
    }
  }
}

TEST(ExactNoise, CropsAndThreadsGiveTheSameBytes) {
  PhysicsNoise noise;
  noise.layout = SensorLayout::named("bayer-rggb");
  for (int c = 0; c < 4; ++c)
    noise.channels.push_back({.gain_dn_per_e = 0.5 + c,
                              .lambda = -0.1,
                              .mu_dn = 0.1 * c,
                              .sigma_tl_dn = 1.0 + c,
                              .sigma_row_dn = 0.3});
  noise.row_drift = {0.7, 5.0};
  Image clean(61, 83);
  for (int r = 0; r < 61; ++r)
    for (int c = 0; c < 83; ++c) clean(r, c) = static_cast<float>(r * 7 + c) * 0.37f;
  const int all = thread_count();
  set_thread_count(1);
  Image whole(61, 83);
  add_noise_exact(noise, clean, whole, {.seed = 5, .frame = 7});
  set_thread_count(7);
  Image crop = Image(30, 41);
  const DrawAddress place{.seed = 5, .frame = 7, .row0 = 13, .col0 = 29};
  add_noise_exact(noise, clean.view().window(13, 29, 30, 41), crop, place);
  set_thread_count(0);
  for (int r = 0; r < 30; ++r)
    for (int c = 0; c < 41; ++c) ASSERT_EQ(crop(r, c), whole(r + 13, c + 29));
  EXPECT_EQ(thread_count(), all);
  Image other(61, 83);
  add_noise_exact(noise, clean, other, {.seed = 5, .frame = 8});
  EXPECT_NE(other.values(), whole.values());
}

TEST(ExactNoise, OddInputsAreDefined) {
  PhysicsNoise noise = mono_noise({2.0, 0.0, 0.0, 0.0, 0.0});
  noise.parts.quantization = false;
  Image clean(1, 4);
  clean(0, 0) = -7.25f;
  clean(0, 1) = std::numeric_limits<float>::quiet_NaN();
  clean(0, 2) = std::numeric_limits<float>::infinity();
  clean(0, 3) = 0.0f;
  add_noise_exact(noise, clean, clean, {});
  EXPECT_EQ(clean(0, 0), -7.25f);
  EXPECT_TRUE(std::isnan(clean(0, 1)));
  EXPECT_TRUE(std::isinf(clean(0, 2)));
  EXPECT_EQ(clean(0, 3), 0.0f);
}

TEST(ExactNoise, ImpossibleParametersAreRefused) {
  const Image clean(2, 2);
  Image noisy(2, 2);
  for (const auto& bad :
       {mono_noise({0, 0, 0, 1, 0}), mono_noise({1, -0.5, 0, 1, 0}), mono_noise({1, 0, 0, -1, 0}),
        mono_noise({1, 0, 0, 1, -1}), mono_noise({1, 0, std::nan(""), 1, 0})})
    EXPECT_THROW(add_noise_exact(bad, clean, noisy, {}), InputError);
  PhysicsNoise two = mono_noise({1, 0, 0, 1, 0});
  two.channels.resize(2);
  EXPECT_THROW(add_noise_exact(two, clean, noisy, {}), InputError);
}

}  // namespace
}  // namespace malus
