// The compiled sampler: same bits on every instruction set and place, and the distribution of the
// plain definition.
#include "malus/synthesize/compiled.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/noise/distribution.h"
#include "malus/noise/tukey_lambda.h"
#include "malus/synthesize/compiled_kernel.h"
#include "malus/synthesize/formation.h"
#include "malus/synthesize/internal/scalar_formation.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "sample_moments.h"
#include "sixteen_channels.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::excess_kurtosis_of;
using testing::moments_of;
using testing::mono_noise;
using testing::sixteen_channels;

// Signals from below zero over a few electrons to saturation, NaN and infinity among them.
Image mixed_signals(int rows, int cols) {
  Image image(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const int kind = (r * 31 + c * 17) % 97;
      image(r, c) = kind == 0   ? std::numeric_limits<float>::quiet_NaN()
                    : kind == 1 ? std::numeric_limits<float>::infinity()
                    : kind < 20 ? static_cast<float>(kind - 6) * 0.31f
                    : kind < 50 ? static_cast<float>(kind) * 1.7f
                                : static_cast<float>(kind * kind) * 0.43f;
    }
  return image;
}

bool same_bytes(const Image& a, const Image& b) {
  return a.size() == b.size() &&
         std::equal(a.values().begin(), a.values().end(), b.values().begin(), [](float x, float y) {
           return std::bit_cast<std::uint32_t>(x) == std::bit_cast<std::uint32_t>(y);
         });
}

class EveryTarget : public ::testing::TestWithParam<std::string> {
 protected:
  void SetUp() override { internal::force_kernel_target(GetParam()); }
  void TearDown() override { internal::force_kernel_target(""); }
};

// The scalar twin, written out here pixel by pixel, is the reference for all instruction sets.
TEST_P(EveryTarget, EqualsTheScalarTwinBitForBit) {
  std::vector<std::vector<TailLine>> tables;
  for (const PhysicsChannel& p : sixteen_channels().channels)
    append_tukey_lambda_lines(p.lambda, tables.emplace_back());
  for (const bool read : {true, false}) {
    PhysicsNoise noise = sixteen_channels();
    noise.parts.read = read;
    const CompiledNoise compiled(noise);
    const Image clean = mixed_signals(37, 131);
    Image noisy(37, 131);
    const DrawAddress place{.seed = 0x1234567890ABCDEF, .frame = 77, .row0 = 5, .col0 = 19};
    compiled.apply(clean, noisy, place);
    using A = scalar::Arithmetic;
    const auto deviates = row_deviates(place, 37, 2, noise.row_drift);
    for (int r = 0; r < 37; ++r) {
      const auto z = static_cast<float>(deviates[static_cast<std::size_t>(r)]);
      for (int c = 0; c < 131; ++c) {
        const PhysicsChannel& p =
            noise.channels[static_cast<std::size_t>(noise.layout.channel_at(5 + r, 19 + c))];
        const auto& lines =
            tables[static_cast<std::size_t>(noise.layout.channel_at(5 + r, 19 + c))];
        const scalar::ChannelLanes<A> lanes{
            static_cast<float>(p.gain_dn_per_e),
            static_cast<float>(1.0 / p.gain_dn_per_e),
            0.0f,
            static_cast<float>(p.sigma_tl_dn),
            static_cast<float>(p.mu_dn) + static_cast<float>(p.sigma_row_dn) * z,
            0u - kTailFirst};
        const PixelWords words = pixel_words(place.seed, place.frame, 5 + r, 19 + c);
        const FormationTables shared{normal_tail_lines().data(), read ? lines.data() : nullptr,
                                     ShotKind::kPoisson, 1.0f};
        const float expected =
            scalar::noisy_pixel<A>(clean(r, c), lanes, shared, words.shot, words.read);
        ASSERT_EQ(std::bit_cast<std::uint32_t>(noisy(r, c)), std::bit_cast<std::uint32_t>(expected))
            << r << ' ' << c << ' ' << clean(r, c) << ' ' << noisy(r, c) << ' ' << expected;
      }
    }
  }
}

TEST_P(EveryTarget, ThreadsTilesCropsAndPlaceGiveTheSameBytes) {
  const CompiledNoise compiled(sixteen_channels());
  const Image clean = mixed_signals(150, 203);
  Image whole(150, 203);
  set_thread_count(1);
  compiled.apply(clean, whole, {.seed = 3, .frame = 9});
  for (const int threads : {2, 7}) {
    set_thread_count(threads);
    Image again = clean;  // in place
    compiled.apply(again.view(), again.view(), {.seed = 3, .frame = 9});
    EXPECT_TRUE(same_bytes(again, whole)) << threads;
  }
  set_thread_count(0);
  for (const int tile : {1, 13, 32, 50}) {
    Image tiled(150, 203);
    for (int r = 0; r < 150; r += tile)
      for (int c = 0; c < 203; c += tile) {
        const int rows = std::min(tile, 150 - r), cols = std::min(tile, 203 - c);
        compiled.apply(clean.view().window(r, c, rows, cols), tiled.view().window(r, c, rows, cols),
                       {.seed = 3, .frame = 9, .row0 = r, .col0 = c});
      }
    EXPECT_TRUE(same_bytes(tiled, whole)) << tile;
  }
  Image other(150, 203);
  compiled.apply(clean, other, {.seed = 4, .frame = 9});
  EXPECT_FALSE(same_bytes(other, whole));
  compiled.apply(clean, other, {.seed = 3, .frame = 10});
  EXPECT_FALSE(same_bytes(other, whole));
}

TEST_P(EveryTarget, IntegerInAndOutRoundsClipsAndPutsTheBlackBack) {
  PhysicsNoise noise = sixteen_channels();
  noise.parts = {.shot = true, .read = true, .row = true, .quantization = false, .bias = true};
  const CompiledNoise compiled(noise);
  CameraOutput camera;
  for (int c = 0; c < 16; ++c) camera.black_dn.push_back(60.0 + c);
  camera.white_dn = 1000;
  camera.step_dn = 2;
  const Image clean = mixed_signals(40, 75);
  Image noisy(40, 75);
  Plane<std::uint16_t> raw(40, 75), clean_raw(40, 75), raw2(40, 75);
  compiled.apply(clean, noisy, {.seed = 1});
  compiled.apply(clean.view(), raw.view(), {.seed = 1}, camera);
  for (int r = 0; r < 40; ++r)
    for (int c = 0; c < 75; ++c) {
      const double black = 60.0 + noise.layout.channel_at(r, c);
      const double want =
          std::isnan(noisy(r, c))
              ? 0.0
              : std::clamp(2 * std::nearbyint((static_cast<double>(noisy(r, c)) + black) / 2), 0.0,
                           1000.0);
      ASSERT_EQ(raw(r, c), want) << clean(r, c);
      clean_raw(r, c) = static_cast<std::uint16_t>(70 + (r * c) % 900);
    }
  // Raw in: the same as its float above black.
  Image above(40, 75), from_raw(40, 75);
  for (int r = 0; r < 40; ++r)
    for (int c = 0; c < 75; ++c)
      above(r, c) = static_cast<float>(clean_raw(r, c)) -
                    static_cast<float>(60 + noise.layout.channel_at(r, c));
  compiled.apply(above, noisy, {.seed = 2});
  compiled.apply(clean_raw.view(), from_raw.view(), {.seed = 2}, camera);
  EXPECT_TRUE(same_bytes(noisy, from_raw));
  compiled.apply(above.view(), raw.view(), {.seed = 2}, camera);
  compiled.apply(clean_raw.view(), raw2.view(), {.seed = 2}, camera);
  EXPECT_EQ(raw.values(), raw2.values());
}

INSTANTIATE_TEST_SUITE_P(Compiled, EveryTarget, ::testing::ValuesIn(internal::kernel_targets()),
                         [](const auto& target) { return target.param; });

TEST(TailLines, StayWithinTheirStatedError) {
  const auto worst = [](const std::vector<TailLine>& lines, auto&& upper_quantile, double from) {
    double error = 0;
    for (double p = from; p < 0.4999; p *= 1.0007) {
      const auto word = static_cast<std::uint32_t>(p * 0x1p32);
      const float x = static_cast<float>(word) + 0.5f;
      const TailLine& line = lines[(std::bit_cast<std::uint32_t>(x) >> kTailShift) - kTailFirst];
      const double value = static_cast<double>(std::fma(line.b, x, line.a));
      error = std::max(error, std::abs(value - upper_quantile(static_cast<double>(x) * 0x1p-32)));
    }
    return error;
  };
  const auto normal = [](double p) { return -normal_quantile(p); };
  EXPECT_LT(worst(normal_tail_lines(), normal, 1e-6), 4e-5);
  for (const double lambda : {-0.3, -0.1, 0.0, 0.14, 0.3}) {
    const auto upper = [lambda](double p) { return -tukey_lambda_quantile(p, lambda); };
    EXPECT_LT(worst(tail_lines(upper), upper, 1e-6) / std::sqrt(tukey_lambda_variance(lambda)),
              lambda < 0 ? 4e-4 : 4e-5)
        << lambda;
  }
}

TEST(TailLines, TukeyLambdaFactorsGiveTheQuantileFunction) {
  for (const double lambda :
       {-0.49, -0.3, -0.05, -1e-9, 0.0, 1e-13, 1e-5, 0.14, 0.3, 1.0, 2.5, 8.0}) {
    const auto expected =
        tail_lines([lambda](double p) { return -tukey_lambda_quantile(p, lambda); });
    std::vector<TailLine> lines(3);  // others' lines stay in front
    append_tukey_lambda_lines(lambda, lines);
    ASSERT_EQ(lines.size(), expected.size() + 3);
    for (std::size_t i = 0; i + 1 < expected.size(); ++i) {
      const double x =
          std::ldexp(1.0 + static_cast<double>(i % 64) / 64, static_cast<int>(i / 64) - 1);
      const auto value = [x](const TailLine& line) {
        return static_cast<double>(line.a) + static_cast<double>(line.b) * x;
      };
      // Two roundings of a and b x, which nearly cancel close to the median.
      const double rounding = 0x1p-22 * (std::abs(static_cast<double>(expected[i].a)) +
                                         std::abs(static_cast<double>(expected[i].b)) * x);
      ASSERT_NEAR(value(lines[i + 3]), value(expected[i]), rounding) << lambda << ' ' << i;
    }
    EXPECT_NEAR(lines.back().a, 0, 1e-12);
    EXPECT_EQ(lines.back().b, 0);
  }
}

// Counts below the true quantiles: each is binomial; five standard deviations.
void expect_distribution(const PhysicsChannel& channel, double signal, int frames) {
  const PhysicsNoise noise = mono_noise(channel);
  const CompiledNoise compiled(noise);
  const Image clean(512, 1024, static_cast<float>(signal));
  Image noisy(512, 1024);
  const PixelDistribution truth(channel, noise.parts, noise.quantization_dn, signal);
  const std::vector<double> probabilities{1e-5, 1e-3, 0.02, 0.2, 0.5, 0.8, 0.98, 0.999, 1 - 1e-5};
  std::vector<double> at, below(probabilities.size(), 0.0);
  for (const double p : probabilities) at.push_back(truth.quantile(p));
  Moments moments;
  for (int f = 0; f < frames; ++f) {
    compiled.apply(clean, noisy, {.seed = 11, .frame = static_cast<std::uint32_t>(f)});
    for (const float v : noisy.values()) {
      moments.add(static_cast<double>(v) - signal);
      for (std::size_t i = 0; i < at.size(); ++i) below[i] += static_cast<double>(v) < at[i];
    }
  }
  const auto n = static_cast<double>(moments.count());
  for (std::size_t i = 0; i < at.size(); ++i) {
    const double p = probabilities[i];
    EXPECT_NEAR(below[i] / n, p, 5 * std::sqrt(p * (1 - p) / n)) << signal << " p=" << p;
  }
  EXPECT_NEAR(moments.mean(), truth.mean_dn() - signal, 5 * std::sqrt(truth.variance_dn2() / n));
  EXPECT_NEAR(moments.variance(), truth.variance_dn2(), 5 * moments.variance_standard_error());
}

TEST(Compiled, DrawsTheNumericDistribution) {
  for (const double signal : {0.0, 0.3, 5.0, 7.9, 8.1, 60.0, 3000.0})
    expect_distribution({.gain_dn_per_e = 0.8, .lambda = 0.1, .mu_dn = -1, .sigma_tl_dn = 0.9},
                        signal, 2);
  // High gain, little read noise: the electrons show as separate peaks.
  for (const double signal : {4.0, 45.0, 60.0, 900.0})
    expect_distribution({.gain_dn_per_e = 5.0, .lambda = -0.25, .mu_dn = 0, .sigma_tl_dn = 0.3},
                        signal, 2);
}

TEST(Compiled, OtherParametersOnTheSameTablesAreACompilationAnew) {
  for (const bool gaussian : {false, true})
    for (const bool read : {true, false}) {
      PhysicsNoise noise = sixteen_channels(), other = noise;
      noise.parts.read = other.parts.read = read;
      other.parts.quantization = false;
      for (PhysicsChannel& channel : other.channels) {
        channel.gain_dn_per_e *= 1.7;
        channel.mu_dn += 3;
        channel.sigma_tl_dn *= 0.6;
        channel.sigma_row_dn *= 2;
      }
      const auto compile = [gaussian](const PhysicsNoise& n) {
        return gaussian ? CompiledNoise::poisson_gaussian(n) : CompiledNoise(n);
      };
      const Image clean = mixed_signals(20, 50);
      Image anew(20, 50), reused(20, 50);
      compile(other).apply(clean, anew, {.seed = 1});
      compile(noise).with_parameters(other).apply(clean, reused, {.seed = 1});
      EXPECT_TRUE(same_bytes(anew, reused));
    }
}

TEST(Compiled, PureShotNoiseIsWholeElectrons) {
  PhysicsNoise noise = mono_noise({.gain_dn_per_e = 1.0});
  noise.parts = {.shot = true, .read = false, .row = false, .quantization = false, .bias = false};
  const CompiledNoise compiled(noise);
  Image clean(64, 256), noisy(64, 256);
  for (int r = 0; r < 64; ++r)
    for (int c = 0; c < 256; ++c) clean(r, c) = static_cast<float>(r * 256 + c) * 0.01f;
  compiled.apply(clean, noisy, {});
  for (const float v : noisy.values()) {
    ASSERT_GE(v, -1e-5f);
    ASSERT_NEAR(v, std::round(v), 2e-5f);
  }
}

// A tenth of a thousandth of an electron is light, too.
TEST(Compiled, ShotNoiseKeepsTheFaintestLight) {
  for (const float mean : {1e-4f, 1e-5f, 1e-6f, 1e-7f}) {
    const auto word = [mean](double share) {
      return static_cast<std::uint32_t>(share * static_cast<double>(mean) * 0x1p32);
    };
    EXPECT_EQ(shot_upper_tail(mean, word(0.5)), 1.0f) << mean;
    EXPECT_EQ(shot_upper_tail(mean, word(2.0)), 0.0f) << mean;
  }
  EXPECT_EQ(shot_upper_tail(0.0f, 0), 0.0f);
  PhysicsNoise noise = mono_noise({.gain_dn_per_e = 1.0});
  noise.parts = {.shot = true, .read = false, .row = false, .quantization = false, .bias = false};
  constexpr int kSide = 2048;
  const Image clean(kSide, kSide, 3e-5f);
  Image noisy(kSide, kSide);
  CompiledNoise(noise).apply(clean, noisy, {.seed = 3});
  double electrons = 0;
  for (const float v : noisy.values()) electrons += std::round(static_cast<double>(v));
  const double expected = 3e-5 * kSide * kSide;
  EXPECT_NEAR(electrons, expected, 4 * std::sqrt(expected));
}

TEST(Compiled, GaussianKindHasTheStatedVariance) {
  const CompiledNoise compiled = CompiledNoise::gaussian(
      SensorLayout::named("mono"), {{.slope_dn = 0.5, .offset_dn2 = -1.0}}, 1);
  for (const double signal : {0.0, 1.0, 10.0, 500.0}) {
    const Image clean(400, 500, static_cast<float>(signal));
    Image noisy(400, 500);
    compiled.apply(clean, noisy, {.seed = 8});
    const Moments m = moments_of(noisy);
    const double variance = std::max(0.0, 0.5 * signal - 1.0);
    EXPECT_NEAR(m.mean(), signal, 5 * std::sqrt(variance / 2e5) + 1e-9);
    EXPECT_NEAR(m.variance(), variance, 5 * m.variance_standard_error() + 1e-9);
  }
}

// Averaged references have pixels below black.
TEST(Compiled, GaussianKindHasTheDarkNoiseWhereTheSignalIsNegative) {
  const CompiledNoise compiled = CompiledNoise::gaussian(SensorLayout::named("mono"),
                                                         {{.slope_dn = 1.5, .offset_dn2 = 9.0}}, 1);
  const Image dark(64, 200), negative(64, 200, -7.0f);
  Image noise(64, 200), noisy(64, 200);
  compiled.apply(dark, noise, {.seed = 8});
  compiled.apply(negative, noisy, {.seed = 8});
  for (int r = 0; r < 64; ++r)
    for (int c = 0; c < 200; ++c) ASSERT_NEAR(noisy(r, c), noise(r, c) - 7.0f, 1e-5f);
}

TEST(Compiled, PoissonGaussianKeepsTheVarianceAndLosesTheTails) {
  const PhysicsNoise noise = mono_noise({.gain_dn_per_e = 1, .lambda = -0.2, .sigma_tl_dn = 1.0});
  const CompiledNoise compiled = CompiledNoise::poisson_gaussian(noise);
  const Image clean(400, 500);
  Image noisy(400, 500);
  compiled.apply(clean, noisy, {.seed = 8});
  const Moments m = moments_of(noisy);
  EXPECT_NEAR(m.variance(), tukey_lambda_variance(-0.2) + 1.0 / 12,
              5 * m.variance_standard_error());
  EXPECT_NEAR(excess_kurtosis_of(m), 0, 0.06);
}

}  // namespace
}  // namespace malus
