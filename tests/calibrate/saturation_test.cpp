#include "malus/calibrate/internal/saturation.h"

#include "malus/base/random.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr double kGainOfWell = 0.3;

DarkPoint quiet_dark() {
  DarkPoint dark;
  dark.variance_dn2 = 1.5;
  dark.variance_stderr_dn2 = 0.003;
  dark.pixels = 16384;
  dark.row_groups = 128;
  return dark;
}

// Mean and variance of a normal variable that is cut off at c deviations above its mean, per
// deviation.
struct CutOff {
  double mean, variance;
};
CutOff cut_off(double c) {
  const double below = 0.5 * std::erfc(-c / std::numbers::sqrt2), above = 1 - below;
  const double density = std::exp(-0.5 * c * c) / std::sqrt(2 * std::numbers::pi);
  const double mean = c * above - density;
  return {mean, below - c * density + c * c * above - mean * mean};
}

// Two frames per level; shot noise of a well that holds `well_e` electrons.
std::vector<TransferLevel> levels_of(const std::vector<double>& electrons, double well_e,
                                     RandomSequence* random = nullptr) {
  std::vector<TransferLevel> levels;
  for (const double e : electrons) {
    const CutOff cut = cut_off((well_e - e) / std::sqrt(e));
    TransferLevel level;
    level.mean_dn = kGainOfWell * (e + std::sqrt(e) * cut.mean);
    level.dark_variance_dn2 = 1.5;
    level.variance_dn2 = 1.5 + kGainOfWell * kGainOfWell * e * cut.variance;
    if (random) level.variance_dn2 *= 1 + std::sqrt(2.0 / 16384) * random->normal();
    level.frames = 2;
    levels.push_back(level);
  }
  return levels;
}

const std::vector<double> kElectrons = {666, 1332, 2663, 3995, 5327, 6658, 7990, 8656};

TEST(Saturation, ALevelAtTheFullWellIsPastTheMaximumOfTheVariance) {
  std::vector<bool> top(8, false);
  top[7] = true;
  for (const double well : {8550.0, 8600.0, 8650.0, 8700.0})
    EXPECT_EQ(saturated_levels(levels_of(kElectrons, well), quiet_dark()), top) << well;
  std::vector<bool> five(8, false);
  std::fill(five.begin() + 3, five.end(), true);
  EXPECT_EQ(saturated_levels(levels_of(kElectrons, 3500), quiet_dark()), five);
  EXPECT_EQ(saturated_levels(levels_of(kElectrons, 1e6), quiet_dark()),
            std::vector<bool>(8, false));
}

// A smooth droop lowers the variance without end; what is left out is a level that fell.
TEST(Saturation, ADroopingCameraAndOneLoudLevelAreNotSaturated) {
  auto drooping = levels_of(kElectrons, 1e6);
  for (TransferLevel& level : drooping) {
    const double droop = 0.05 * level.mean_dn / 4000;
    level.mean_dn *= 1 - droop;
    level.variance_dn2 = 1.5 + (level.variance_dn2 - 1.5) * std::pow(1 - 2 * droop, 2);
  }
  EXPECT_EQ(saturated_levels(drooping, quiet_dark()), std::vector<bool>(8, false));
  auto loud = levels_of(kElectrons, 1e6);
  loud[3].variance_dn2 *= 10;
  EXPECT_EQ(saturated_levels(loud, quiet_dark()), std::vector<bool>(8, false));
}

// Far values of a heavy tail in the first two levels: all others are short of those levels' gain by
// more than a quarter, but their variance rises. So it does up to a full well further up.
TEST(Saturation, WhereTheVarianceRisesAgainNothingIsSaturated) {
  const auto loud_first = [](double well) {
    auto levels = levels_of(kElectrons, well);
    levels[0].variance_dn2 += 60;
    levels[1].variance_dn2 += 120;
    return levels;
  };
  EXPECT_EQ(saturated_levels(loud_first(1e6), quiet_dark()), std::vector<bool>(8, false));
  const auto past = saturated_levels(loud_first(6000), quiet_dark());
  EXPECT_EQ(std::count(past.begin(), past.end(), true), 3);
  EXPECT_TRUE(past[5] && past[6] && past[7]);
}

// Two slopes, as for a high dynamic range: beyond the knee both variance and mean rise, the one
// with the square of the second slope. All of it is past the maximum, or the first level beyond the
// knee counts for K (a half: 20 % too small).
TEST(Saturation, LevelsBeyondAKneeArePastTheMaximum) {
  for (const double slope : {0.25, 0.5}) {
    std::vector<double> electrons;
    for (int k = 1; k <= 12; ++k) electrons.push_back(1000.0 * k);
    auto levels = levels_of(electrons, 1e6);
    std::vector<bool> beyond;
    for (TransferLevel& level : levels) {
      constexpr double kKneeDn = kGainOfWell * 7500;
      beyond.push_back(level.mean_dn > kKneeDn);
      if (!beyond.back()) continue;
      level.mean_dn = kKneeDn + slope * (level.mean_dn - kKneeDn);
      level.variance_dn2 = 1.5 + slope * slope * (level.variance_dn2 - 1.5);
    }
    EXPECT_EQ(saturated_levels(levels, quiet_dark()), beyond) << slope;
  }
}

// At five standard errors once in three million levels; 16 channels of 1000 sessions.
TEST(Saturation, ChanceSaturatesNothing) {
  RandomSequence random(11, 0, Draw::kOther);
  int found = 0;
  for (int i = 0; i < 16000; ++i) {
    const auto past = saturated_levels(levels_of(kElectrons, 1e6, &random), quiet_dark());
    found += std::count(past.begin(), past.end(), true) > 0;
  }
  EXPECT_LE(found, 1);
}

}  // namespace
}  // namespace malus
