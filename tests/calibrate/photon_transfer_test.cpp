#include "malus/calibrate/internal/photon_transfer.h"

#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/internal/dark_point.h"
#include "malus/calibrate/internal/response_bend.h"

#include <array>
#include <cmath>

#include "simulated_session.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr double kGain = 0.7, kDarkVariance = 6.0;

DarkPoint dark_point() {
  DarkPoint dark;
  dark.variance_dn2 = kDarkVariance;
  dark.variance_stderr_dn2 = 0.01;
  dark.row_variance_dn2 = 0.25;
  dark.pixels = 1000;
  dark.row_groups = 30;
  return dark;
}

std::vector<TransferLevel> exact_levels(int count) {
  std::vector<TransferLevel> levels;
  for (int i = 1; i <= count; ++i) {
    TransferLevel level;
    level.mean_dn = 200.0 * i;
    level.variance_dn2 = kDarkVariance + kGain * level.mean_dn;
    level.frames = 2;
    level.dark_variance_dn2 = kDarkVariance;
    levels.push_back(level);
  }
  return levels;
}

TEST(PhotonTransfer, ExactPointsGiveTheExactLine) {
  const auto fit = fit_photon_transfer(exact_levels(8), dark_point());
  ASSERT_TRUE(fit.decided());
  EXPECT_NEAR(fit->slope_dn_per_e, kGain, 1e-9);
  EXPECT_NEAR(fit->intercept_dn2, 0.0, 1e-6);
  EXPECT_EQ(fit->excess_deviation_dn2, 0.0);
}

// Dark frames that are noisier the longer they are, unlike the flats of their exposures: the error
// of the line is a number, too.
TEST(PhotonTransfer, AVarianceThatFallsIsToldWithItsError) {
  auto levels = exact_levels(8);
  for (TransferLevel& level : levels) {
    level.variance_dn2 = kDarkVariance;
    level.dark_variance_dn2 = kDarkVariance + 1.75 * level.mean_dn;
  }
  const auto fit = fit_photon_transfer(levels, dark_point());
  ASSERT_FALSE(fit.decided());
  EXPECT_THAT(fit.reason(), ::testing::HasSubstr("slope -1.75 ± "));
  EXPECT_THAT(fit.reason(), ::testing::Not(::testing::HasSubstr("nan")));
}

// Of 3 frames of 20 rows of 10 normal pixels, by simulation: 20000 variances have a relative
// standard error of 1 % of their variance. Column noise had been left out: a seventh of the squared
// error here, and most of it in little light (37 of 40 faultless sessions of 2.5 DN were told to be
// not linear).
TEST(PhotonTransfer, TheVarianceOfFramesHasTheErrorThatIsStated) {
  DarkPoint dark;
  dark.row_variance_dn2 = 1.0;
  dark.column_variance_dn2 = 0.64;
  dark.variance_dn2 = 4.0 + dark.row_variance_dn2 + dark.column_variance_dn2;
  dark.pixels = 200;
  dark.row_groups = 20;
  dark.columns = 10;
  RandomSequence random(12, 0, Draw::kOther);
  Moments variance;
  for (int repeat = 0; repeat < 20000; ++repeat) {
    double sum = 0;
    std::array<double, 30> of_columns{};
    for (double& column : of_columns) column = 0.8 * random.normal();
    for (int row = 0; row < 20; ++row) {
      const std::array<double, 3> offset = {random.normal(), random.normal(), random.normal()};
      for (std::size_t pixel = 0; pixel < 10; ++pixel) {
        Moments frames;
        for (std::size_t f = 0; f < 3; ++f)
          frames.add(offset[f] + of_columns[3 * pixel + f] + 2.0 * random.normal());
        sum += frames.variance() / 200;
      }
    }
    variance.add(sum);
  }
  const double stated = variance_error_dn4(0.0, 3, dark, 0.0);
  EXPECT_NEAR(variance.variance() / stated, 1.0, 0.045);
}

// Of 3 frames of 120 rows that drift: σ_b⁴ / G had been stated, an eighth of the squared error.
TEST(PhotonTransfer, DriftOfTheRowsIsInTheErrorOfAVariance) {
  constexpr int kRows = 120, kFrames = 3, kRepeats = 3000;
  constexpr double kShare = 0.9, kLength = 8.0, kRow = 2.0;
  PhysicsCalibration bias;
  bias.bias_frames = kFrames;
  bias.sigma_row.mean = {kRow};
  bias.sigma_column.mean = {0.0};
  bias.row_drift.drift = {kShare, kLength};
  const DarkPoint dark =
      dark_point(0, MosaicGeometry(SensorLayout::named("mono"), kRows, 1000, 1), kRow * kRow, bias);
  const double decay = std::exp(-1.0 / kLength);
  RandomSequence random(13, 0, Draw::kOther);
  Moments variance;
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    std::array<double, kFrames> slow{};
    for (double& s : slow) s = random.normal();
    double sum = 0;
    for (int row = 0; row < kRows; ++row) {
      Moments frames;
      for (double& s : slow) {
        frames.add(kRow * (std::sqrt(kShare) * s + std::sqrt(1 - kShare) * random.normal()));
        s = decay * s + std::sqrt(1 - decay * decay) * random.normal();
      }
      sum += frames.variance() / kRows;
    }
    variance.add(sum);
  }
  EXPECT_NEAR(variance.variance() / variance_error_dn4(0.0, kFrames, dark, 0.0), 1.0, 0.12);
}

// Half of the dark noise cut off: the rest has a third of its variance, about a mean that is too
// high.
TEST(PhotonTransfer, ADarkPointThatIsCutOffDoesNotBendTheLine) {
  auto levels = exact_levels(8);
  for (TransferLevel& level : levels) {
    level.mean_dn -= 1.0;
    level.dark_variance_dn2 = kDarkVariance / 3;
  }
  DarkPoint dark = dark_point();
  dark.variance_dn2 = kDarkVariance / 3;
  EXPECT_GT(fit_photon_transfer(levels, dark)->slope_dn_per_e, 1.001 * kGain);
  dark.cut_off = true;
  EXPECT_NEAR(fit_photon_transfer(levels, dark)->slope_dn_per_e, kGain, 1e-9);
}

// Levels of a sensor whose signal s is measured as s (1 - droop s / full), by simulation of their
// variances' sampling errors; full is what the 12th level would reach without droop.
std::vector<TransferLevel> drooping_levels(double droop, bool exposures_known,
                                           RandomSequence& random) {
  auto levels = exact_levels(12);
  const double full = levels.back().mean_dn;
  for (TransferLevel& level : levels) {
    const double s = level.mean_dn;
    level.exposure_s = exposures_known ? s : 0.0;
    level.mean_dn = s * (1 - droop * s / full) * (1 + 1e-4 * random.normal());
    level.variance_dn2 = kDarkVariance + kGain * s * std::pow(1 - 2 * droop * s / full, 2);
    level.variance_dn2 *= 1 + std::sqrt(2.0 / 16384) * random.normal();
  }
  return levels;
}

// Root mean square of the distance from the truth over the stated error; 200 repeats know it to
// 5 %. Without exposures the variances alone must show the bend, which these do from 2 % on.
TEST(PhotonTransfer, ANonlinearSensorsErrorHoldsTheGainWithoutLight) {
  DarkPoint dark = dark_point();
  dark.pixels = 16384;
  for (const bool known : {true, false})
    for (const double droop : {0.01, 0.02, 0.03}) {
      if (!known && droop < 0.02) continue;
      RandomSequence random(5, 0, Draw::kOther);
      double squares = 0.0, bent = 0.0;
      constexpr int kRepeats = 200;
      for (int i = 0; i < kRepeats; ++i) {
        const auto fit = fit_photon_transfer(drooping_levels(droop, known, random), dark);
        EXPECT_LT(fit->slope_dn_per_e, kGain);
        bent += fit->response_bend_per_dn * exact_levels(12).back().mean_dn / kRepeats;
        squares += std::pow((fit->slope_dn_per_e - kGain) / fit->slope_stderr, 2) / kRepeats;
      }
      EXPECT_LT(std::sqrt(squares), 1.5) << droop << known;
      EXPECT_NEAR(bent, droop, 0.25 * droop) << known;  // of variances only those that show
    }
}

// A lamp that was turned up as the exposures were made longer: light goes with their square. The
// error of K was 10^7 times K.
TEST(PhotonTransfer, ExposuresThatTellNoLightTellNoBend) {
  auto levels = exact_levels(8);
  double phase = 0;
  for (TransferLevel& level : levels)
    level.exposure_s = 1e-3 * std::sqrt(level.mean_dn * (1 + 1e-4 * std::sin(phase += 3)));
  const auto fit = fit_photon_transfer(levels, dark_point());
  EXPECT_TRUE(fit->exposures_tell_no_light);
  EXPECT_EQ(fit->bend_dn_per_e, 0.0);
  EXPECT_LT(fit->slope_stderr, 0.02 * kGain);
  RandomSequence random(7, 0, Draw::kOther);
  for (const double droop : {0.0, 0.03, 0.1})
    EXPECT_FALSE(fit_photon_transfer(drooping_levels(droop, true, random), dark_point())
                     ->exposures_tell_no_light);
}

// 3e-4 of chance by the means and 3.2e-4 by the variances: of 4000 curves 2.5, more than 9 once in
// 2000.
TEST(PhotonTransfer, ALinearSensorIsNotCalledNonlinear) {
  DarkPoint dark = dark_point();
  dark.pixels = 16384;
  RandomSequence random(6, 0, Draw::kOther);
  int found = 0;
  for (int i = 0; i < 4000; ++i) {
    auto levels = drooping_levels(0.0, true, random);
    for (TransferLevel& level : levels) level.mean_dn *= 1 + 0.003 * random.normal();
    found += fit_photon_transfer(levels, dark)->bend_dn_per_e != 0.0;
  }
  EXPECT_LE(found, 9);
}

// Published quantiles of Student's distribution.
TEST(PhotonTransfer, TheChanceOfStudentsTIsThatOfTheTables) {
  EXPECT_NEAR(student_chance(12.7062, 1), 0.05, 1e-6);
  EXPECT_NEAR(student_chance(31.5991, 2), 0.001, 1e-7);
  EXPECT_NEAR(student_chance(12.9240, 3), 0.001, 1e-7);
  EXPECT_NEAR(student_chance(8.6103, 4), 0.001, 1e-7);
  EXPECT_NEAR(student_chance(2.5706, 5), 0.05, 1e-5);
  EXPECT_NEAR(student_chance(2.2281, 10), 0.05, 1e-5);
}

TEST(PhotonTransfer, ScatterFollowsTheStandardErrorAndTwoSeHoldTheTruth) {
  constexpr int kRepeats = 400;
  RandomSequence random(3, 0, Draw::kOther);
  Moments z;
  for (int i = 0; i < kRepeats; ++i) {
    auto levels = exact_levels(12);
    for (TransferLevel& level : levels)  // Gaussian pixels: s² has relative sd sqrt(2 / (P (M-1)))
      level.variance_dn2 *= 1 + std::sqrt(2.0 / 1000) * random.normal();
    const auto fit = fit_photon_transfer(levels, dark_point());
    z.add((fit->slope_dn_per_e - kGain) / fit->slope_stderr);
  }
  EXPECT_LT(std::abs(z.mean()), 4 / std::sqrt(kRepeats));
  EXPECT_NEAR(z.variance(), 1.0, 4 * std::sqrt(2.0 / kRepeats));
}

// The variance of the two dark frames that all levels are measured against: relative sd
// sqrt(2 / 1000) once, the same for every level. 400 repeats: the variance of z has a standard
// deviation of 0.07.
TEST(PhotonTransfer, LevelsWithTheSameDarkFramesShareTheirError) {
  constexpr int kRepeats = 400;
  RandomSequence random(4, 0, Draw::kOther);
  DarkPoint dark = dark_point();
  dark.row_variance_dn2 = 0;
  Moments slope, intercept;
  for (int i = 0; i < kRepeats; ++i) {
    auto levels = exact_levels(12);
    const double pair = kDarkVariance * (1 + std::sqrt(2.0 / 1000) * random.normal());
    dark.variance_dn2 = kDarkVariance + dark.variance_stderr_dn2 * random.normal();
    for (TransferLevel& level : levels) {
      level.mean_dn /= 200;
      level.frames = 40;
      level.dark_frames = 2;
      level.dark_variance_dn2 = pair;
      level.variance_dn2 = kDarkVariance + kGain * level.mean_dn;
      const double fourth = kGain * kGain * kGain * level.mean_dn / (40 * 1000.0);
      level.variance_dn2 +=
          std::sqrt(2.0 / 39 / 1000 * level.variance_dn2 * level.variance_dn2 + fourth) *
          random.normal();
    }
    const auto fit = fit_photon_transfer(levels, dark);
    slope.add((fit->slope_dn_per_e - kGain) / fit->slope_stderr);
    intercept.add(fit->intercept_dn2 / fit->intercept_stderr_dn2);
  }
  for (const Moments& z : {slope, intercept}) {
    EXPECT_LT(std::abs(z.mean()), 4 / std::sqrt(kRepeats));
    EXPECT_NEAR(z.variance(), 1.0, 4 * std::sqrt(2.0 / kRepeats));
  }
}

// Dark current as strong as the light, a dark pair for every level: both pairs have its shot noise,
// of which the errors knew nothing. K scattered by 1.9 of them, and every other line was called no
// straight one. 400 repeats: the variance of z has a standard deviation of 0.07, and a chance of 1
// in 10000 calls a line that.
TEST(PhotonTransfer, DarkCurrentIsInTheErrorOfItsLevels) {
  constexpr int kRepeats = 400;
  RandomSequence random(5, 0, Draw::kOther);
  DarkPoint dark = dark_point();
  dark.row_variance_dn2 = 0;
  const auto drawn = [&](double variance_dn2) {
    const double fourth = kGain * kGain * (variance_dn2 - kDarkVariance) / (2 * 1000.0);
    return variance_dn2 +
           std::sqrt(2.0 / 1000 * variance_dn2 * variance_dn2 + fourth) * random.normal();
  };
  Moments slope;
  int scattered = 0;
  for (int i = 0; i < kRepeats; ++i) {
    auto levels = exact_levels(8);
    for (std::size_t k = 0; k < levels.size(); ++k) {
      const double light = kGain * levels[k].mean_dn;
      levels[k].dark_frames = 2;
      levels[k].dark_set = static_cast<int>(k);
      levels[k].dark_variance_dn2 = drawn(kDarkVariance + light);
      levels[k].variance_dn2 = drawn(kDarkVariance + 2 * light);
    }
    const auto fit = fit_photon_transfer(levels, dark);
    slope.add((fit->slope_dn_per_e - kGain) / fit->slope_stderr);
    scattered += fit->excess_deviation_dn2 > 0;
  }
  EXPECT_LT(std::abs(slope.mean()), 4 / std::sqrt(kRepeats));
  EXPECT_NEAR(slope.variance(), 1.0, 4 * std::sqrt(2.0 / kRepeats));
  EXPECT_LE(scattered, 2);
}

// Of ever more levels with one dark pair the error stays; with a pair each it averages out.
TEST(PhotonTransfer, DarkFramesOfTheirOwnTellMoreThanSharedOnes) {
  auto levels = exact_levels(12);
  for (TransferLevel& level : levels) {
    level.mean_dn /= 200;
    level.variance_dn2 = kDarkVariance + kGain * level.mean_dn;
    level.frames = 40;
    level.dark_frames = 2;
  }
  const auto shared = fit_photon_transfer(levels, dark_point());
  for (std::size_t i = 0; i < levels.size(); ++i) levels[i].dark_set = static_cast<int>(i);
  const auto own = fit_photon_transfer(levels, dark_point());
  EXPECT_NEAR(shared->slope_dn_per_e, kGain, 1e-9);
  EXPECT_NEAR(own->slope_dn_per_e, kGain, 1e-9);
  EXPECT_GT(shared->intercept_stderr_dn2, 1.5 * own->intercept_stderr_dn2);
}

// Two frames: Var(s²) = 2σ⁴/P + κ4/(2P) for any distribution of a pixel's noise.
TEST(PhotonTransfer, HeavyTailsOfTheDarkNoiseWidenTheError) {
  const auto levels = exact_levels(8);
  const auto normal = fit_photon_transfer(levels, dark_point());
  DarkPoint heavy = dark_point();
  heavy.fourth_cumulant_dn4 = 20 * kDarkVariance * kDarkVariance;
  const auto fit = fit_photon_transfer(levels, heavy);
  for (std::size_t i = 0; i < levels.size(); ++i)
    EXPECT_NEAR(
        std::pow(fit->variance_stderr_dn2[i], 2) - std::pow(normal->variance_stderr_dn2[i], 2),
        heavy.fourth_cumulant_dn4 / (2.0 * 1000), 1e-9);
  EXPECT_GT(fit->slope_stderr, normal->slope_stderr);
}

TEST(PhotonTransfer, RefusedLevelsDoNotCountAndOneOutlierBarely) {
  auto levels = exact_levels(12);
  levels[11].variance_dn2 *= 0.3;
  levels[11].refused.reason = Refusal::kWhite;
  EXPECT_NEAR(fit_photon_transfer(levels, dark_point())->slope_dn_per_e, kGain, 1e-9);
  levels[4].variance_dn2 *= 1.6;  // someone walked through the light
  const auto fit = fit_photon_transfer(levels, dark_point());
  EXPECT_NEAR(fit->slope_dn_per_e, kGain, 3 * fit->slope_stderr);
}

TEST(PhotonTransfer, ABentCurveWidensTheError) {
  auto straight = exact_levels(12), bent = exact_levels(12);
  for (TransferLevel& level : bent) {
    level.variance_dn2 *= 1 - level.mean_dn / 6000;
    level.frames = straight[0].frames = 50;
  }
  const auto fit = fit_photon_transfer(bent, dark_point());
  ASSERT_TRUE(fit.decided());
  EXPECT_GT(fit->chi_square_per_level, 5);
  EXPECT_GT(fit->excess_deviation_dn2, 0);
  EXPECT_GT(fit->slope_stderr, 2 * fit_photon_transfer(straight, dark_point())->slope_stderr);
}

TEST(PhotonTransfer, VarianceThatDoesNotRiseIsRefused) {
  auto levels = exact_levels(6);
  for (TransferLevel& level : levels) level.variance_dn2 = 0.5 * kDarkVariance;
  const auto fit = fit_photon_transfer(levels, dark_point());
  ASSERT_FALSE(fit.decided());
  EXPECT_NE(fit.reason().find("does not rise"), std::string::npos);
}

TEST(PhotonTransfer, OneLevelCannotDecide) {
  const auto fit = fit_photon_transfer(exact_levels(1), dark_point());
  ASSERT_FALSE(fit.decided());
  EXPECT_NE(fit.reason().find("1 usable light level"), std::string::npos);
}

// Black level 0: half of the dark noise is gone, but the light's is not.
TEST(PhotonTransfer, HoldsForACameraThatCutsItsDarkNoiseOff) {
  testing::SimulatedCamera camera = testing::small_camera();
  camera.black_dn = 0;
  for (PhysicsChannel& channel : camera.gains[0].noise.channels) {
    channel.sigma_tl_dn *= 3;
    channel.sigma_row_dn *= 8;
  }
  const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
  double deviations = 0;
  for (std::size_t c = 0; c < 16; ++c)
    deviations += (p.K.mean.at(c) - camera.gains[0].noise.channels[c].gain_dn_per_e) /
                  p.K.standard_error[c] / 4;  // of the sum of sixteen
  EXPECT_LT(std::abs(deviations), 3);
  EXPECT_THAT(p.warnings, ::testing::Contains(::testing::HasSubstr("K rests on the flat frames")));
}

}  // namespace
}  // namespace malus
