#include "malus/calibrate/level_histograms.h"

#include "malus/base/random.h"

#include <cmath>
#include <numeric>

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(NoiseBinEdges, FineAtZeroAndWideEnoughOutside) {
  const auto edges = noise_bin_edges(2.0, 40.0, 128);
  ASSERT_EQ(edges.size(), 129u);
  EXPECT_NEAR(edges.back(), 7 * 40.0, 1e-6);
  EXPECT_NEAR(edges[64], 0.0, 1e-12);
  EXPECT_LE(edges[65] - edges[64], 2.0 / 6 * 1.001);
  for (std::size_t i = 0; i < 128; ++i) {
    EXPECT_LT(edges[i], edges[i + 1]);
    EXPECT_NEAR(edges[i], -edges[128 - i], 1e-9);
  }
  const auto uniform = noise_bin_edges(2.0, 2.0, 128);
  EXPECT_NEAR(uniform[1] - uniform[0], uniform[70] - uniform[69], 1e-9);
}

LevelHistograms with_noise(int samples, double step_dn) {
  LevelHistograms histograms(noise_bin_edges(1.0, 3.0, 64), step_dn, 100.0);
  RandomSequence random(1, 0, Draw::kUser);
  for (int level = 0; level < 10; ++level)
    for (int i = 0; i < samples; ++i)
      histograms.add(level * 10.0 + 1.0, std::sqrt(1 + 0.08 * level * 10) * random.normal());
  return histograms;
}

TEST(LevelHistograms, KeepMomentsAndMeanSignal) {
  const auto result = with_noise(20000, 10.0).result(20000);
  EXPECT_EQ(result.refused_levels, 0);
  ASSERT_EQ(result.channel.level_dn.size(), 10u);
  for (std::size_t l = 0; l < 10; ++l) {
    EXPECT_NEAR(result.channel.level_dn[l], 10.0 * static_cast<double>(l) + 1.0, 1e-6);
    EXPECT_EQ(result.channel.samples[l], 20000);
    const double variance = 1 + 0.8 * static_cast<double>(l);
    const LevelMoments moments = level_moments(result.channel, l);
    EXPECT_NEAR(moments.mean_dn, 0, 5 * std::sqrt(variance / 20000));
    // Four sampling errors, and the width of the bins squared over 12.
    EXPECT_NEAR(moments.variance_dn2, variance, variance * (4 * std::sqrt(2.0 / 20000) + 0.01));
  }
}

TEST(LevelHistograms, FewSamplesBorrowOrAreRefused) {
  // Levels 10 DN apart in steps of 5 DN: every second level is empty, neighbours lie two away.
  const auto borrowed = with_noise(1000, 5.0).result(2500);
  EXPECT_EQ(borrowed.refused_levels, 0);
  EXPECT_EQ(borrowed.channel.samples[4], 3000);
  EXPECT_NEAR(borrowed.channel.level_dn[4], 41.0, 1e-6);
  EXPECT_EQ(borrowed.channel.samples[0], 2000);
  EXPECT_NEAR(borrowed.channel.level_dn[0], 6.0, 1e-6);
  const auto refused = with_noise(1000, 5.0).result(100000);
  EXPECT_EQ(refused.refused_levels, 10);
  EXPECT_TRUE(refused.channel.level_dn.empty());
}

TEST(LevelHistograms, NothingIsCutOff) {
  LevelHistograms histograms(noise_bin_edges(1.0, 1.0, 32), 1.0, 4.0);
  for (int i = 0; i < 10; ++i) histograms.add(0.0, 0.1);
  histograms.add(0.0, 55.0);
  histograms.add(99.0, -2.0);
  const auto result = histograms.result(1);
  EXPECT_EQ(result.channel.bin_edges_dn.back(), 55.0);
  EXPECT_EQ(result.channel.bin_edges_dn.front(), -55.0);
  ASSERT_EQ(result.channel.level_dn.size(), 2u);
  EXPECT_NEAR(result.channel.pmf[0].back(), 1.0 / 11, 1e-12);
  for (const auto& pmf : result.channel.pmf)
    EXPECT_NEAR(std::accumulate(pmf.begin(), pmf.end(), 0.0), 1.0, 1e-12);
}

}  // namespace
}  // namespace malus
