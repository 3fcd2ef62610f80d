#include "malus/calibrate/level_histograms.h"

#include "malus/base/normal_distribution.h"
#include "malus/base/random.h"
#include "malus/base/statistics.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(NoiseBinEdges, FineAtTheCentreAndWideEnoughOutside) {
  const auto edges = noise_bin_edges(2.0, 40.0, 240, 5.0);
  EXPECT_NEAR(static_cast<double>(edges.size()), 241, 4);
  EXPECT_GE(edges.back(), 5.0 + 7 * 40.0 - 1e-6);
  EXPECT_LE(edges.front(), 5.0 - 7 * 40.0 + 1e-6);
  for (std::size_t i = 0; i + 1 < edges.size(); ++i) {
    EXPECT_LT(edges[i], edges[i + 1]);
    const double finest = std::abs(edges[i] - 5.0) < 13 ? 2.0 / 6 * 1.001 : 1e9;
    EXPECT_LE(edges[i + 1] - edges[i], finest);
  }
}

TEST(NoiseBinEdges, LieBetweenTheCodesOfAnIntegerConverter) {
  for (const double sd : {0.7, 3.0, 30.0}) {
    const auto edges = noise_bin_edges(sd, 60.0, 240, -0.6, {1.0, 0.25});
    for (std::size_t i = 0; i + 1 < edges.size(); ++i) {
      const double width = edges[i + 1] - edges[i];
      EXPECT_GT(width, 0);
      // Whole codes, or whole parts of one.
      const double codes = width >= 0.999 ? width : 1 / width;
      EXPECT_NEAR(codes, std::round(codes), 1e-6);
    }
    for (int code = -3; code <= 3; ++code)
      EXPECT_TRUE(std::any_of(edges.begin(), edges.end(),
                              [&](double e) { return std::abs(e - (code + 0.75)) < 1e-6; }) ||
                  sd > 20)
          << sd << " " << code;
  }
}

std::vector<double> by_code(const DarkDensity& density) {
  std::vector<double> codes(density.probability.size() / static_cast<std::size_t>(density.parts));
  for (std::size_t i = 0; i < density.probability.size(); ++i)
    codes[i / static_cast<std::size_t>(density.parts)] += density.probability[i];
  return codes;
}

TEST(WithoutRowNoise, BlurringTheResultGivesTheObservation) {
  // A converter whose even codes are 10 % too wide, with a row noise of half a step.
  constexpr int kReach = 20, kParts = 50;
  constexpr double kRow = 0.5;
  std::vector<double> truth, observed(2 * kReach + 1, 0.0);
  double sum = 0;
  for (int k = -kReach; k <= kReach; ++k)
    truth.push_back(std::exp(-0.5 * k * k / 9.0) * (k % 2 == 0 ? 1.1 : 0.9));
  for (double t : truth) sum += t;
  for (int k = -kReach; k <= kReach; ++k) {
    std::vector<double> at, share;
    double all = 0;
    for (int j = 0; j < kParts; ++j) {
      at.push_back(k - 0.5 + (j + 0.5) / kParts);
      share.push_back(std::exp(-0.5 * at.back() * at.back() / 9.0));
      all += share.back();
    }
    for (int to = -kReach; to <= kReach; ++to)
      for (std::size_t j = 0; j < at.size(); ++j)
        observed[static_cast<std::size_t>(to + kReach)] +=
            truth[static_cast<std::size_t>(k + kReach)] / sum * share[j] / all *
            (normal_cdf((to + 0.5 - at[j]) / kRow) - normal_cdf((to - 0.5 - at[j]) / kRow));
  }
  const auto found = by_code(without_row_noise(observed, 1.0, 0.5));
  for (std::size_t k = 10; k < 31; ++k)
    EXPECT_NEAR(found[k], truth[k] / sum, 0.05 * truth[k] / sum) << k;
  EXPECT_NEAR(std::accumulate(found.begin(), found.end(), 0.0), 1.0, 1e-12);
}

// Normal noise of about half a code, which its codes tell to a per cent: for noise that is even
// inside each code there is no distribution behind these codes (7 % too much of it was drawn in the
// dark, and 20 to 50 % a fraction of a code above).
TEST(WithoutRowNoise, NoiseThatIsNarrowAgainstACodeIsThatBeforeRounding) {
  const struct {
    double pixel, row, mean;
  } cases[] = {
      {0.57, 0.2, 0.0}, {0.57, 0.2, 0.4}, {0.5, 0.0, 0.0}, {0.5, 0.1, 0.5}, {1.2, 0.05, 0.3}};
  for (const auto& [pixel, row, mean] : cases) {
    constexpr int kReach = 15;
    const double all = std::hypot(pixel, row);
    std::vector<double> observed;
    for (int k = -kReach; k <= kReach; ++k)
      observed.push_back(normal_cdf((k + 0.5 - mean) / all) - normal_cdf((k - 0.5 - mean) / all));
    const DarkDensity found = without_row_noise(observed, 1.0, row);
    const double width = 1.0 / found.parts;
    double variance = width * width / 12;
    std::vector<double> again(observed.size(), 0.0);
    for (std::size_t i = 0; i < found.probability.size(); ++i) {
      const double at = (static_cast<double>(i) + 0.5) * width - 0.5 - kReach;
      variance += found.probability[i] * (at - mean) * (at - mean);
      for (std::size_t k = 0; k < again.size(); ++k) {
        const double below = static_cast<double>(k) - 0.5 - kReach - at;
        again[k] += found.probability[i] * (normal_cdf((below + 1) / std::hypot(row, 1e-6)) -
                                            normal_cdf(below / std::hypot(row, 1e-6)));
      }
    }
    EXPECT_NEAR(variance / (pixel * pixel), 1.0, 0.02) << pixel << " " << mean;
    for (std::size_t k = 0; k < again.size(); ++k)
      EXPECT_NEAR(again[k], observed[k], 2e-3) << pixel << " " << mean << " " << k;
  }
}

// Without the hot pixels nothing is left but what rounding makes of a variance, 1e-24 or so: the
// code was one part as wide as it is.
TEST(WithoutRowNoise, OneCodeBesideHotPixelsIsAsFineAsNoiseCanBe) {
  for (const double count : {3072.0, 65536.0, 1e6, 4e6})
    for (const double hot : {1.0, 2.0, 5.0, 20.0, 50.0})
      for (const std::size_t away : {1u, 2u, 5u}) {
        std::vector<double> observed(30, 0.0);
        observed[0] = hot;
        observed[4] = count;
        observed[4 + away] = 3;
        observed[29] = 7;
        EXPECT_EQ(without_row_noise(observed, 1.0, 0.0).parts, 8) << count << " " << hot;
      }
}

// Rows of five deviations of a pixel: the result had 1.4 times the pixels' deviation. One pixel in
// 10^4 is hot.
TEST(WithoutRowNoise, WhatRowsWidenedFiveTimesIsNarrowAgain) {
  constexpr int kReach = 150, kHot = 120;
  constexpr double kRow = 5, kPixel = 1, kHotShare = 1e-4;
  const double all = std::hypot(kRow, kPixel);
  std::vector<double> observed;
  for (int k = -kReach; k <= kReach; ++k)
    observed.push_back(
        (1 - kHotShare) * (normal_cdf((k + 0.5) / all) - normal_cdf((k - 0.5) / all)) +
        kHotShare * (normal_cdf((k - kHot + 0.5) / kRow) - normal_cdf((k - kHot - 0.5) / kRow)));
  const DarkDensity found = without_row_noise(observed, 1.0, kRow);
  const double width = 1.0 / found.parts;
  double square = 0, hot = 0, mean = 0, total = 0;
  for (std::size_t i = 0; i < found.probability.size(); ++i) {
    const double p = found.probability[i],
                 at = (static_cast<double>(i) + 0.5) * width - 0.5 - kReach;
    if (at > kHot / 2) {
      hot += p;
      continue;
    }
    total += p;
    mean += p * at;
    square += p * at * at;
  }
  mean /= total;
  EXPECT_NEAR(hot, kHotShare, 0.01 * kHotShare);
  EXPECT_NEAR(mean, 0, 0.01);
  EXPECT_NEAR(std::sqrt(square / total - mean * mean + width * width / 12), kPixel, 0.03);
}

// Wild rows and hot pixels of a few hundred values that lie over all codes of 16 bits: every code
// was blurred to every other, for hours where the rows were wild enough.
TEST(WithoutRowNoise, CodesThatDoNotOccurTakeNoTime) {
  constexpr std::size_t kCodes = 65536;
  std::vector<double> observed(kCodes, 0.0);
  for (std::size_t i = 0; i < 300; ++i)
    observed[i * (kCodes - 1) / 299] += 1.0 + static_cast<double>(i % 7);
  const auto began = std::chrono::steady_clock::now();
  const DarkDensity found = without_row_noise(observed, 1.0, 200.0);
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(5));
  ASSERT_EQ(found.probability.size(), kCodes);
  double elsewhere = 0;
  for (std::size_t i = 0; i < kCodes; ++i)
    if (observed[i] == 0) elsewhere += found.probability[i];
  EXPECT_EQ(elsewhere, 0);
  EXPECT_NEAR(std::accumulate(found.probability.begin(), found.probability.end(), 0.0), 1, 1e-9);
}

// Half of the noise is below the lowest code, and rows bring it up and down: a deconvolution of
// what shows moved a fifth of that code's pixels to the next ones.
TEST(WithoutRowNoise, TheLowestCodeOfNoiseThatIsCutOffStaysAsProbable) {
  constexpr int kReach = 60;
  for (const auto& [pixel, row] : {std::pair{8.0, 1.0}, {8.0, 4.0}, {2.0, 1.0}}) {
    const double all = std::hypot(pixel, row);
    const auto below = [](double code, double deviation) {
      return normal_cdf((code + 0.5) / deviation);
    };
    std::vector<double> observed{below(0, all)};
    for (int k = 1; k <= kReach; ++k) observed.push_back(below(k, all) - below(k - 1, all));
    const DarkDensity found = without_row_noise(observed, 1.0, row, true);
    EXPECT_EQ(found.codes_below, static_cast<std::size_t>(std::ceil(5 * row)));
    std::vector<double> again(observed.size(), 0.0);
    double mean_above = 0;
    for (std::size_t i = 0; i < found.probability.size(); ++i) {
      const double at = (static_cast<double>(i) + 0.5) / found.parts - 0.5 -
                        static_cast<double>(found.codes_below);
      again[0] += found.probability[i] * below(-at, row);
      for (int k = 1; k <= kReach; ++k)
        again[static_cast<std::size_t>(k)] +=
            found.probability[i] * (below(k - at, row) - below(k - 1 - at, row));
      if (at > 0) mean_above += found.probability[i] * at;
    }
    for (std::size_t k = 0; k < observed.size(); ++k)
      EXPECT_NEAR(again[k], observed[k], 1e-3) << pixel << " " << row << " " << k;
    // E max(x, 0) of the pixels alone.
    EXPECT_NEAR(mean_above / (pixel / std::sqrt(2 * std::numbers::pi)), 1.0, 0.01) << row;
  }
}

LevelHistograms with_noise(int samples, double step_dn) {
  LevelHistograms histograms(noise_bin_edges(1.0, 3.0, 64), step_dn, 100.0);
  RandomSequence random(1, 0, Draw::kOther);
  for (int level = 0; level < 10; ++level)
    for (int i = 0; i < samples; ++i)
      histograms.add(level * 10.0 + 1.0, std::sqrt(1 + 0.08 * level * 10) * random.normal());
  return histograms;
}

TEST(LevelHistograms, KeepMomentsAndMeanSignal) {
  const auto result = with_noise(20000, 10.0).result(20000);
  EXPECT_TRUE(result.refused.empty());
  ASSERT_EQ(result.channel.level_dn.size(), 10u);
  for (std::size_t l = 0; l < 10; ++l) {
    EXPECT_NEAR(result.channel.level_dn[l], 10.0 * static_cast<double>(l) + 1.0, 1e-6);
    EXPECT_EQ(result.channel.samples[l], 20000);
    const double variance = 1 + 0.8 * static_cast<double>(l);
    const LevelMoments moments = level_moments(result.channel, l);
    EXPECT_NEAR(moments.mean_dn, 0, 5 * std::sqrt(variance / 20000));
    // Four sampling errors, and the width of the bins, a third, squared over 4.
    EXPECT_NEAR(moments.variance_dn2, variance, variance * (4 * std::sqrt(2.0 / 20000)) + 0.03);
  }
}

// Differences of two rounded frames about their mean, over the root of what that mean leaves of
// them. Against the same residuals' own variance: no sampling error.
TEST(LevelHistograms, KeepTheVarianceOfResidualsOnALattice) {
  for (const double sd_dn : {0.3, 0.4, 0.5, 0.6, 0.8, 1.0}) {
    LevelHistograms histograms(noise_bin_edges(sd_dn, 10.0, 240, 0.1, {1.0, 0.0}), 16.0, 64.0);
    RandomSequence random(5, 0, Draw::kOther);
    Moments own;
    for (int i = 0; i < 20000; ++i) {
      const double half = 0.5 * (std::round(sd_dn * random.normal() + 0.3) -
                                 std::round(sd_dn * random.normal() + 0.3));
      own.add(half / std::sqrt(0.5));
      histograms.add(32.0, half / std::sqrt(0.5));
    }
    const LevelMoments kept = level_moments(histograms.result(1000).channel, 0);
    // A quarter of a bin's width squared is 0.7 % of the variance.
    EXPECT_NEAR(kept.variance_dn2 / own.variance(), 1.0, 0.015) << sd_dn;
    EXPECT_NEAR(kept.mean_dn, own.mean(), 0.01 * sd_dn) << sd_dn;
  }
}

TEST(LevelHistograms, FewSamplesBorrowOrAreRefused) {
  // Levels 10 DN apart in steps of 5 DN: every second level is empty, neighbours lie two away.
  const auto borrowed = with_noise(1000, 5.0).result(2500);
  EXPECT_TRUE(borrowed.refused.empty());
  EXPECT_EQ(borrowed.channel.samples[4], 3000);
  EXPECT_NEAR(borrowed.channel.level_dn[4], 41.0, 1e-6);
  EXPECT_EQ(borrowed.channel.samples[0], 2000);
  EXPECT_NEAR(borrowed.channel.level_dn[0], 6.0, 1e-6);
  const auto refused = with_noise(1000, 5.0).result(100000);
  EXPECT_EQ(refused.refused.size(), 10u);
  EXPECT_TRUE(refused.channel.level_dn.empty());
}

TEST(LevelHistograms, NothingIsCutOff) {
  LevelHistograms histograms(noise_bin_edges(1.0, 1.0, 32), 1.0, 4.0);
  for (int i = 0; i < 10; ++i) histograms.add(0.0, 0.1);
  histograms.add(0.0, 55.0);
  histograms.add(99.0, -2.0);
  const auto result = histograms.result(1);
  EXPECT_EQ(result.channel.bin_edges_dn.back(), 55.0);
  EXPECT_LE(result.channel.bin_edges_dn.front(), -7.0);
  ASSERT_EQ(result.channel.level_dn.size(), 2u);
  EXPECT_NEAR(result.channel.pmf[0].back(), 1.0 / 11, 1e-12);
  for (const auto& pmf : result.channel.pmf)
    EXPECT_NEAR(std::accumulate(pmf.begin(), pmf.end(), 0.0), 1.0, 1e-12);
}

}  // namespace
}  // namespace malus
