// Non-parametric noise: the calibrated histograms come out again, the same bytes on every
// instruction set, at every place and for any number of threads.
#include "malus/synthesize/level_sampler.h"

#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/synthesize/compiled_kernel.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "sample_moments.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::kSigmas;

NonparametricCalibration two_level_calibration() {
  NonparametricCalibration calibration;
  NonparametricChannel channel;
  channel.level_dn = {0, 100};
  channel.bin_edges_dn = {-3, -1, 0, 1, 5};
  channel.pmf = {{0.1, 0.4, 0.4, 0.1}, {0.35, 0.15, 0.2, 0.3}};
  channel.samples = {1000000, 1000000};
  calibration.channels.assign(4, channel);
  calibration.sigma_row_dn = {0, 0, 0, 0};
  return calibration;
}

TEST(LevelSampler, DrawsTheHistogramExactlyAndMixesLevels) {
  const auto calibration = two_level_calibration();
  const LevelSampler sampler(SensorLayout::named("bayer-rggb"), calibration, 0);
  const auto& edges = calibration.channels[0].bin_edges_dn;
  // 99.99 % point of chi-square with 3 degrees of freedom: 21.1.
  for (const double signal : {-20.0, 0.0, 25.0, 100.0, 300.0}) {
    const double upper = std::clamp(signal / 100.0, 0.0, 1.0);
    const Image clean(400, 500, static_cast<float>(signal));
    Image noisy(400, 500);
    sampler.apply(clean, noisy, {.seed = 6});
    std::vector<double> counts(4, 0.0);
    Moments inside;
    for (const float v : noisy.values()) {
      const double xi = static_cast<double>(v) - signal;
      const auto bin = static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(
          std::upper_bound(edges.begin(), edges.end(), xi) - edges.begin() - 1, 0, 3));
      counts[bin] += 1;
      if (bin == 3) inside.add((xi - 1) / 4);
    }
    double chi2 = 0;
    for (std::size_t b = 0; b < 4; ++b) {
      const double p = (1 - upper) * calibration.channels[0].pmf[0][b] +
                       upper * calibration.channels[0].pmf[1][b];
      const double expected = 200000 * p;
      chi2 += (counts[b] - expected) * (counts[b] - expected) / expected;
    }
    EXPECT_LT(chi2, 21.1) << signal;
    EXPECT_NEAR(inside.mean(), 0.5,
                kSigmas * std::sqrt(1.0 / 12 / static_cast<double>(inside.count())));
    EXPECT_NEAR(inside.variance(), 1.0 / 12, kSigmas * inside.variance_standard_error());
  }
}

TEST(LevelSampler, CropsGiveTheSameBytesAndRowsShareTheirDraw) {
  auto calibration = two_level_calibration();
  calibration.sigma_row_dn = {1, 1, 1, 1};
  calibration.row_drift.drift = {0.5, 2.0};
  const LevelSampler sampler(SensorLayout::named("bayer-rggb"), calibration, 2);
  Image clean(50, 60), whole(50, 60), crop(20, 30);
  for (int r = 0; r < 50; ++r)
    for (int c = 0; c < 60; ++c) clean(r, c) = static_cast<float>(r * c) * 0.1f;
  sampler.apply(clean, whole, {.seed = 7, .frame = 3});
  sampler.apply(clean.view().window(11, 17, 20, 30), crop,
                {.seed = 7, .frame = 3, .row0 = 11, .col0 = 17});
  for (int r = 0; r < 20; ++r)
    for (int c = 0; c < 30; ++c) ASSERT_EQ(crop(r, c), whole(r + 11, c + 17));
}

// Above the brightest level the variance is V + K above, as far as asked for; the levels below keep
// their draws to the bit.
TEST(LevelSampler, NoiseGrowsAboveTheBrightestLevel) {
  auto calibration = two_level_calibration();
  const SensorLayout layout = SensorLayout::named("bayer-rggb");
  const LevelSampler plain(layout, calibration, 0);
  const LevelSampler unknown(layout, calibration, 0, 4000);
  calibration.K.assign(4, 0.5);
  const LevelSampler continued(layout, calibration, 0, 4000);
  const LevelMoments last = level_moments(calibration.channels[0], 1);
  Image noisy(400, 500), other(400, 500);
  for (const double signal : {30.0, 100.0}) {
    const Image clean(400, 500, static_cast<float>(signal));
    plain.apply(clean, noisy, {.seed = 9});
    continued.apply(clean, other, {.seed = 9});
    for (std::size_t i = 0; i < noisy.size(); ++i) ASSERT_EQ(noisy.values()[i], other.values()[i]);
  }
  for (const double signal : {103.0, 150.0, 700.0, 4000.0}) {
    const Image clean(400, 500, static_cast<float>(signal));
    continued.apply(clean, noisy, {.seed = 9});
    const Moments m = testing::moments_of(noisy);
    EXPECT_NEAR(m.variance(), last.variance_dn2 + 0.5 * (signal - 100),
                kSigmas * m.variance_standard_error() + 1e-3 * m.variance())
        << signal;
    EXPECT_NEAR(m.mean(), signal + last.mean_dn, kSigmas * std::sqrt(m.variance() / 2e5));
    unknown.apply(clean, noisy, {.seed = 9});
    EXPECT_NEAR(testing::moments_of(noisy).variance(), last.variance_dn2, 0.05 * last.variance_dn2);
  }
}

TEST(LevelSampler, UnevenLevelsAreFound) {
  // One bin per level whose place tells the level: noise = level number, width nearly nothing.
  NonparametricCalibration calibration;
  NonparametricChannel channel;
  channel.level_dn = {0, 0.5, 2, 3, 70, 71, 1000};
  for (int b = 0; b <= 7; ++b) channel.bin_edges_dn.push_back(b);
  for (std::size_t l = 0; l < 7; ++l) {
    channel.pmf.emplace_back(7, 0.0);
    channel.pmf.back()[l] = 1;
  }
  calibration.channels = {channel};
  const LevelSampler sampler(SensorLayout::named("mono"), calibration, 0);
  for (std::size_t l = 0; l < 7; ++l) {
    const Image clean(8, 64, static_cast<float>(channel.level_dn[l]));
    Image noisy(8, 64);
    sampler.apply(clean, noisy, {});
    for (const float v : noisy.values())
      ASSERT_EQ(std::floor(static_cast<double>(v) - channel.level_dn[l]), static_cast<double>(l));
  }
}

// Channels that differ in levels, bins and row noise; level steps uneven.
std::vector<std::vector<LevelDistribution>> uneven_channels() {
  std::vector<std::vector<LevelDistribution>> channels;
  for (int c = 0; c < 4; ++c) {
    const std::size_t bins = 5 + 3 * static_cast<std::size_t>(c);
    channels.emplace_back();
    for (int l = 0; l < 1 + 7 * c; ++l) {
      LevelDistribution level;
      level.level_dn = 0.5 * l * l * l + 3 * c;
      for (std::size_t b = 0; b <= bins; ++b)
        level.bin_edges_dn.push_back(0.3 * (l + 1) * (static_cast<double>(b * b) - 9));
      for (std::size_t b = 0; b < bins; ++b)
        level.pmf.push_back(static_cast<double>((b * 7 + static_cast<std::size_t>(l)) % 5));
      channels.back().push_back(level);
    }
  }
  return channels;
}

Image signals_around_levels(int rows, int cols) {
  Image image(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const int kind = (r * 31 + c * 17) % 97;
      image(r, c) = kind == 0   ? std::numeric_limits<float>::quiet_NaN()
                    : kind == 1 ? -std::numeric_limits<float>::infinity()
                                : static_cast<float>(kind * kind) * 0.9f - 40.0f;
    }
  return image;
}

// One pixel as the definition says it, without the joint tables.
float plain_level_noise(const std::vector<LevelDistribution>& levels, float signal_dn,
                        PixelWords words) {
  std::size_t level = 0;
  const auto at = [&](std::size_t l) { return static_cast<float>(levels[l].level_dn); };
  while (level + 2 < levels.size() && signal_dn >= at(level + 1)) ++level;
  if (levels.size() > 1) {
    const float distance = (signal_dn - at(level)) / (at(level + 1) - at(level)) * 65536.0f;
    if (static_cast<float>(words.read & 0xFFFFu) < distance) ++level;
  }
  const auto cells = alias_cells(levels[level].pmf);
  const std::uint64_t product = std::uint64_t{words.shot} * cells.size();
  auto bin = static_cast<std::size_t>(product >> 32);
  if ((static_cast<std::uint32_t>(product) >> 8) >= cells[bin].threshold) bin = cells[bin].alias;
  const double start = levels[level].bin_edges_dn[bin];
  const auto width = static_cast<float>(levels[level].bin_edges_dn[bin + 1] - start);
  const float inside = (static_cast<float>(words.read >> 16) + 0.5f) * 0x1p-16f;
  return static_cast<float>(start) + width * inside;
}

class EveryLevelTarget : public ::testing::TestWithParam<std::string> {
 protected:
  void SetUp() override { internal::force_kernel_target(GetParam()); }
  void TearDown() override { internal::force_kernel_target(""); }
};

TEST_P(EveryLevelTarget, EqualsThePlainDefinitionBitForBit) {
  const auto channels = uneven_channels();
  const SensorLayout layout = SensorLayout::named("bayer-rggb");
  const std::vector<double> sigma_row{0.5, 1, 1.5, 2};
  const RowDrift drift{0.6, 4.0};
  const LevelSampler sampler(layout, channels, sigma_row, 2, drift);
  const Image signal = signals_around_levels(23, 131);
  Image base(23, 131), noisy(23, 131);
  for (int r = 0; r < 23; ++r)
    for (int c = 0; c < 131; ++c) base(r, c) = static_cast<float>(r - c);
  base(4, 5) = std::numeric_limits<float>::infinity();
  const DrawAddress place{.seed = 0xFEDCBA9876543210, .frame = 3, .row0 = 7, .col0 = 41};
  sampler.apply(signal, base, noisy, place);
  const auto deviates = row_deviates(place, 23, 2, drift);
  for (int r = 0; r < 23; ++r) {
    const auto z = static_cast<float>(deviates[static_cast<std::size_t>(r)]);
    for (int c = 0; c < 131; ++c) {
      const auto channel = static_cast<std::size_t>(layout.channel_at(7 + r, 41 + c));
      float expected = base(r, c);
      if (std::isfinite(signal(r, c)) && std::isfinite(base(r, c)))
        expected = expected +
                   plain_level_noise(channels[channel], signal(r, c),
                                     pixel_words(place.seed, place.frame, 7 + r, 41 + c)) +
                   static_cast<float>(sigma_row[channel]) * z;
      ASSERT_EQ(std::bit_cast<std::uint32_t>(noisy(r, c)), std::bit_cast<std::uint32_t>(expected))
          << r << ' ' << c << ' ' << signal(r, c) << ' ' << noisy(r, c) << ' ' << expected;
    }
  }
}

TEST_P(EveryLevelTarget, ThreadsAndTilesGiveTheSameBytes) {
  const LevelSampler sampler(SensorLayout::named("bayer-rggb"), uneven_channels(), {1, 1, 1, 1}, 2,
                             {0.6, 4.0});
  Image signal(60, 203);
  for (int r = 0; r < 60; ++r)
    for (int c = 0; c < 203; ++c) signal(r, c) = static_cast<float>((r * 37 + c * 11) % 4000);
  Image whole(60, 203);
  set_thread_count(1);
  sampler.apply(signal, whole, {.seed = 3});
  for (const int threads : {2, 7}) {
    set_thread_count(threads);
    Image again = signal;  // in place
    sampler.apply(again.view(), again.view(), {.seed = 3});
    EXPECT_EQ(again.values(), whole.values()) << threads;
  }
  set_thread_count(0);
  for (const int tile : {1, 13, 32}) {
    Image tiled(60, 203);
    for (int r = 0; r < 60; r += tile)
      for (int c = 0; c < 203; c += tile) {
        const int rows = std::min(tile, 60 - r), cols = std::min(tile, 203 - c);
        sampler.apply(signal.view().window(r, c, rows, cols), tiled.view().window(r, c, rows, cols),
                      {.seed = 3, .row0 = r, .col0 = c});
      }
    EXPECT_EQ(tiled.values(), whole.values()) << tile;
  }
}

INSTANTIATE_TEST_SUITE_P(LevelSampler, EveryLevelTarget,
                         ::testing::ValuesIn(internal::kernel_targets()),
                         [](const auto& target) { return target.param; });

}  // namespace
}  // namespace malus
