#include "malus/calibrate/internal/rounded_noise.h"

#include "malus/base/normal_distribution.h"
#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/gaussian_calibration.h"
#include "malus/calibrate/internal/dark_point.h"
#include "malus/noise/physics.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

#include "simulated_session.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

// Rounded normal noise of 64 x 64 pixels about offsets with a fixed pattern, in steps of 1 DN.
CodePairs pairs_of(double mean, double pattern, double noise, int frames, std::uint64_t seed,
                   double base_dn = 100) {
  constexpr int kSize = 64;
  RandomSequence random(seed, 0, Draw::kOther);
  std::vector<double> offset;
  for (int i = 0; i < kSize * kSize; ++i)
    offset.push_back(base_dn + mean + pattern * random.normal());
  CodePairCounter counter(MosaicGeometry(SensorLayout::named("mono"), kSize, kSize, 1), 1.0);
  Image dn(kSize, kSize);
  for (int f = 0; f < frames; ++f) {
    for (int i = 0; i < kSize * kSize; ++i)
      dn(i / kSize, i % kSize) = static_cast<float>(
          std::max(std::round(offset[static_cast<std::size_t>(i)] + noise * random.normal()), 0.0));
    counter.add(dn);
  }
  if (base_dn == 0) counter.end_at(0, 0);
  return counter.pairs()[0];
}

// Within four of the stated errors, which are below a tenth: once in 16000 by chance.
TEST(RoundedNoise, TellsNoiseBelowHalfAStepFromTheFixedPattern) {
  std::uint64_t seed = 1;
  int decided = 0;
  for (const double noise : {0.12, 0.23, 0.35})
    for (const double pattern : {0.0, 0.1, 0.5, 2.0})
      for (const double mean : {0.0, 0.3, 0.5}) {
        const auto fit = fit_rounded_noise(pairs_of(mean, pattern, noise, 30, ++seed));
        if (!fit) {  // pixels that change between two codes alone
          EXPECT_LT(std::hypot(pattern, noise), 0.3) << noise << " " << pattern << " " << mean;
          continue;
        }
        ++decided;
        EXPECT_NEAR(fit->sd, noise, 4 * fit->stderr_of_sd)
            << noise << " " << pattern << " " << mean;
        EXPECT_NEAR(fit->sd, noise, 0.1 * noise) << noise << " " << pattern << " " << mean;
        // From the usual code, 100 or 101.
        EXPECT_NEAR(std::remainder(fit->mean - mean, 1.0), 0.0,
                    4 * std::hypot(fit->stderr_of_mean, pattern / 64))
            << noise << " " << pattern << " " << mean;
        EXPECT_NEAR(fit->pattern_sd, pattern, 4 * std::max(fit->stderr_of_pattern_sd, 0.01))
            << noise << " " << pattern << " " << mean;
      }
  EXPECT_GE(decided, 25);
}

// Few values cross a boundary, and the fit may take the pattern for noise: that was stated as if no
// pattern could be, 11 errors off.
TEST(RoundedNoise, HasTheErrorOfAPatternThatDoesNotShow) {
  int without = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const auto fit = fit_rounded_noise(pairs_of(0.0, 0.1, 0.1, 80, seed));
    if (!fit) continue;
    without += fit->pattern_sd == 0;
    EXPECT_NEAR(fit->sd, 0.1, 4 * fit->stderr_of_sd) << seed;
    EXPECT_NEAR(fit->pattern_sd, 0.1, 4 * fit->stderr_of_pattern_sd) << seed;
  }
  EXPECT_GE(without, 1);
}

// Half of the values are below DN 0, which the camera writes as 0: taken for those of half a step
// alone, the noise was a half too small and the mean 0.2 steps too high.
TEST(RoundedNoise, KnowsThatZeroStandsForAllBelowIt) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const auto fit = fit_rounded_noise(pairs_of(0.0, 0.2, 0.6, 30, seed, 0));
    ASSERT_TRUE(fit.decided()) << fit.reason();
    EXPECT_NEAR(fit->sd, 0.6, 4 * fit->stderr_of_sd) << seed;
    EXPECT_LT(fit->stderr_of_sd, 0.05) << seed;
    EXPECT_NEAR(fit->pattern_sd, 0.2, 4 * fit->stderr_of_pattern_sd) << seed;
    EXPECT_NEAR(fit->mean, 0.0, 4 * std::hypot(fit->stderr_of_mean, 0.2 / 64)) << seed;
  }
}

TEST(RoundedNoise, IsUndecidedWhereOneBoundaryIsCrossed) {
  EXPECT_FALSE(fit_rounded_noise(pairs_of(0.5, 0.0, 0.1, 30, 1)).decided());
  EXPECT_FALSE(fit_rounded_noise(pairs_of(0.0, 0.0, 0.02, 30, 1)).decided());
}

testing::SimulatedCamera narrow_camera(double read_dn, double dsnu_dn, std::uint64_t seed) {
  testing::SimulatedCamera camera = testing::mono_camera(0.1, 0.1349, read_dn, 0, seed);
  camera.dsnu_dn = dsnu_dn;
  camera.rows = camera.cols = 96;
  camera.white_dn = 1023;
  return camera;
}

// Dark frames that flicker were drawn constant, read noise was 0. A gain beyond four errors has a
// chance of 6e-5.
TEST(RoundedNoise, IsTheReadNoiseOfACameraWhoseStepHidesIt) {
  for (const double dsnu : {0.0, 0.1, 0.4}) {
    const PhysicsCalibration p = testing::calibrated(narrow_camera(0.23, dsnu, 3)).physics.at(0);
    EXPECT_NEAR(read_noise_dn(p)[0], 0.23, 0.023) << dsnu;
    EXPECT_NEAR(p.K.mean[0], 0.1, 4 * p.K.standard_error[0]) << dsnu;
  }
}

// A DSNU of 0.15 steps was 0.07 to 0.28 of one, a bias of 0.3 steps 0.23, and rows 14 % too large:
// beyond their errors by 4 to 100 of them. Now within four, once in 16000 by chance.
TEST(RoundedNoise, FixedPatternBiasAndRowsAreNotWhatRoundingMakesOfThem) {
  std::uint64_t seed = 10;
  for (const double mu : {0.0, 0.3, 0.5}) {
    testing::SimulatedCamera camera = narrow_camera(0.23, 0.15, ++seed);
    camera.gains[0].noise.channels[0].mu_dn = mu;
    camera.gains[0].noise.channels[0].sigma_row_dn = 0.05;
    const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
    EXPECT_NEAR(p.dsnu_dn[0], 0.15, 4 * p.dsnu_stderr_dn[0]) << mu;
    EXPECT_LT(p.dsnu_stderr_dn[0], 0.01) << mu;
    EXPECT_NEAR(p.mu.mean[0], mu, 4 * p.mu.standard_error[0]) << mu;
    EXPECT_LT(p.mu.standard_error[0], 0.02) << mu;
    EXPECT_NEAR(p.sigma_row.mean[0], 0.05, 4 * p.sigma_row.standard_error[0]) << mu;
    EXPECT_LT(p.sigma_row.standard_error[0], 0.003) << mu;
  }
}

// It was 0 DN with the error of rounded frames: of a DSNU of 0.03 DN, ten of them off.
TEST(RoundedNoise, AFixedPatternThatDoesNotShowHasTheErrorOfTheWidestThatMayBe) {
  int without = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    testing::SimulatedCamera camera = narrow_camera(0.3, 0.03, seed);
    camera.gains[0].noise.channels[0].mu_dn = 0.1;
    camera.rows = camera.cols = 48;
    const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
    without += p.dsnu_dn[0] == 0;
    EXPECT_NEAR(p.dsnu_dn[0], 0.03, 4 * p.dsnu_stderr_dn[0]) << seed;
    EXPECT_LT(p.dsnu_stderr_dn[0], 0.1) << seed;
  }
  EXPECT_GE(without, 1);
}

// Rows of which rounding shows a tenth: they were taken for a third of themselves, 16 errors off.
TEST(RoundedNoise, RowsThatRoundingHidesAreNotTooSmall) {
  for (std::uint64_t seed = 30; seed < 33; ++seed) {
    testing::SimulatedCamera camera = narrow_camera(0.15, 0.1, seed);
    camera.gains[0].noise.channels[0].sigma_row_dn = 0.03;
    const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
    EXPECT_NEAR(p.sigma_row.mean[0], 0.03, 4 * p.sigma_row.standard_error[0]) << seed;
    EXPECT_LT(p.sigma_row.standard_error[0], 0.03) << seed;
  }
}

// Dark frames of such noise hardly change; lit ones hold it and q²/12 without light.
TEST(RoundedNoise, IsInTheOffsetOfAGaussianModel) {
  const GaussianCalibration lit =
      gaussian_of(testing::calibrated(narrow_camera(0.15, 0.1, 40)).physics.at(0));
  EXPECT_NEAR(lit.offset_dn2[0], 0.15 * 0.15 + 1.0 / 12, 4 * lit.offset_stderr_dn2[0]);
  EXPECT_LT(lit.offset_stderr_dn2[0], 0.01);
}

// Changes across one boundary tell no pattern either: its error says so (0.28 ± 0.001 DN before).
TEST(RoundedNoise, AFixedPatternThatIsNotKnownHasTheErrorOfRounding) {
  testing::SimulatedCamera camera = narrow_camera(0.12, 0.15, 20);
  camera.gains[0].noise.channels[0].mu_dn = 0.5;
  const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
  EXPECT_NEAR(p.dsnu_dn[0], 0.15, 2 * p.dsnu_stderr_dn[0]);
  EXPECT_GT(p.dsnu_stderr_dn[0], 0.1);
  EXPECT_GT(p.sigma_row.standard_error[0], 0.28);  // q/√12: it was 0 ± 0 where no rows show
}

// Dark pixels that keep their code: the dark variance is not known, and the line must not be held
// by it. The mean of eight sessions, by the errors that ten flats of a dozen levels have.
TEST(RoundedNoise, ADarkPointThatIsNotKnownDoesNotHoldTheLine) {
  double off = 0.0, error = 0.0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    testing::SimulatedCamera camera = narrow_camera(0.05, 0.0, seed);
    camera.flat_frames = 10;
    camera.white_dn = 255;
    camera.gains[0].noise.channels[0].gain_dn_per_e = 0.02;
    const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
    off += (p.K.mean[0] / 0.02 - 1) / 8;
    error += p.K.standard_error[0] / 0.02 / 8;
  }
  EXPECT_LT(error, 0.005);
  EXPECT_LT(std::abs(off), 4 * error / std::sqrt(8.0));
}

// Eight bits of a camera whose shot noise is below a step in dim flats, too: their variances made
// the sensor "not linear", and K uncertain by 31 % (now 2.5 %).
TEST(RoundedNoise, DimFlatsThatItHidesDoNotBendTheLine) {
  testing::SimulatedCamera camera = narrow_camera(0.06, 0.03, 31);
  camera.white_dn = 31;
  camera.black_dn = 4;
  camera.flat_levels = 12;
  camera.flat_frames = 4;
  camera.prnu = 0.01;
  camera.gains[0].noise.channels[0].gain_dn_per_e = 0.025;
  const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
  EXPECT_NEAR(p.K.mean[0], 0.025, 4 * p.K.standard_error[0]);
  EXPECT_LT(p.K.standard_error[0], 0.04 * 0.025);
  for (const std::string& warning : p.warnings)
    EXPECT_EQ(warning.find("not linear"), std::string::npos) << warning;
}

// The camera's session with something added to every pixel before it is rounded: of (frame, row,
// column).
PhysicsCalibration calibrated_with(testing::SimulatedCamera camera,
                                   const std::function<double(int, int, int)>& added_dn) {
  camera.rounded = false;
  CalibrationInput input = testing::simulated_session(camera);
  int frames = 0;
  for (FrameSet& set : input.sets) {
    testing::change_frames(set, [=, first = frames](RawFrame& frame, int i) {
      for (int r = 0; r < frame.dn.rows(); ++r)
        for (int c = 0; c < frame.dn.cols(); ++c)
          frame.dn(r, c) = static_cast<float>(std::clamp(
              std::round(frame.dn(r, c) + added_dn(first + i, r, c)), 0.0, camera.white_dn));
    });
    frames += set.count;
  }
  return calibrate_physics(input, {}, silent_progress()).physics.at(0);
}

// Row noise was divided by what shows of it, column noise was not: a quarter of itself with an
// error of 4 %, and steady flats were told to be of light that changes across the frame.
TEST(RoundedNoise, ColumnsThatRoundingHidesAreNotTooSmall) {
  for (std::uint64_t seed = 50; seed < 53; ++seed) {
    testing::SimulatedCamera camera = narrow_camera(0.15, 0.1, seed);
    camera.white_dn = 255;
    camera.flat_frames = 4;
    camera.gains[0].noise.channels[0].gain_dn_per_e = 0.05;
    const PhysicsCalibration p = calibrated_with(camera, [&](int frame, int, int c) {
      return 0.1 *
             testing::internal::normal_at(seed, static_cast<std::uint64_t>(frame) << 32 | c, 5);
    });
    EXPECT_NEAR(p.sigma_column.mean[0], 0.1, 4 * p.sigma_column.standard_error[0]) << seed;
    EXPECT_NEAR(p.sigma_column.mean[0], 0.1, 0.03) << seed;
    EXPECT_THAT(p.warnings, Not(Contains(HasSubstr("across the frame")))) << seed;
  }
}

// Whole rows and columns of the fixed pattern are few: DSNU was off by six of its errors.
TEST(RoundedNoise, FixedRowsAndColumnsAreInTheErrorOfTheFixedPattern) {
  for (std::uint64_t seed = 60; seed < 64; ++seed) {
    const auto offset = [&](int at, std::uint32_t stream) {
      return testing::internal::normal_at(seed, static_cast<std::uint64_t>(at), stream);
    };
    const PhysicsCalibration p =
        calibrated_with(narrow_camera(0.25, 0.2, seed),
                        [&](int, int r, int c) { return 0.2 * offset(r, 6) + 0.3 * offset(c, 7); });
    const double truth = std::sqrt(0.2 * 0.2 + 0.2 * 0.2 + 0.3 * 0.3);
    EXPECT_NEAR(p.dsnu_dn[0], truth, 4 * p.dsnu_stderr_dn[0]) << seed;
    EXPECT_GT(p.dsnu_stderr_dn[0], 0.025 * truth) << seed;
    EXPECT_LT(p.dsnu_stderr_dn[0], 0.08 * truth) << seed;
  }
}

// A level that moves from frame to frame by a tenth of a step was taken for noise, 9 % too much of
// it, and the frames farthest off were told to be of another gain.
TEST(RoundedNoise, ALevelThatChangesIsNoNoise) {
  for (std::uint64_t seed = 70; seed < 73; ++seed) {
    testing::SimulatedCamera camera = narrow_camera(0.23, 0.15, seed);
    camera.gains[0].mu_spread_dn = {0.1};
    const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
    EXPECT_NEAR(read_noise_dn(p)[0], 0.23, 0.01) << seed;
    EXPECT_NEAR(p.dsnu_dn[0], 0.15, 4 * p.dsnu_stderr_dn[0]) << seed;
    EXPECT_THAT(p.warnings, Not(Contains(HasSubstr("the pixels' noise is up to")))) << seed;
  }
}

// Dim flats of a bias between two codes: their light was counted from a dark level that rounding
// had moved, and the variance of the dimmest still depends on where in a code they lie. The line
// missed its dark point by three to five stated errors, and was told not to be straight. The mean
// of four sessions within four of its errors.
TEST(RoundedNoise, TheLevelOfDimFlatsIsNotCountedFromARoundedOne) {
  for (const double mu : {0.0, 0.25}) {
    double sum = 0;
    for (std::uint64_t seed = 80; seed < 84; ++seed) {
      testing::SimulatedCamera camera = narrow_camera(0.2, 0.12, seed);
      camera.rows = camera.cols = 160;
      camera.black_dn = 8;
      camera.white_dn = 40;
      camera.flat_frames = 8;
      camera.gains[0].noise.channels[0].gain_dn_per_e = 0.05;
      camera.gains[0].noise.channels[0].mu_dn = mu;
      const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
      sum += p.K_intercept_dn2[0] / p.K_intercept_stderr_dn2[0];
      EXPECT_NEAR(p.K.mean[0], 0.05, 4 * p.K.standard_error[0]) << mu;
      EXPECT_LT(p.K.standard_error[0], 0.01 * 0.05) << mu;
      EXPECT_THAT(p.warnings, Not(Contains(HasSubstr("straight")))) << mu;
    }
    EXPECT_LT(std::abs(sum / 4), 2) << mu;
  }
}

// Of half a step, which is not hidden: what its place in a code makes of the dark variance was in
// no error. The dark deviation was 16 errors off, and straight sensors were told to be bent.
TEST(RoundedNoise, OfHalfAStepHasTheErrorOfItsPlaceInACode) {
  for (std::uint64_t seed = 90; seed < 93; ++seed) {
    testing::SimulatedCamera camera = testing::mono_camera(0.03, 0.14, 0.5, 0.05, seed);
    camera.rows = camera.cols = 320;
    camera.black_dn = 10;
    camera.white_dn = 255;
    camera.dsnu_dn = 0.1;
    camera.flat_levels = 8;
    camera.flat_frames = 4;
    const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
    EXPECT_NEAR(p.temporal_sd_dark_dn[0], std::sqrt(0.25 + 0.0025 + 1.0 / 12),
                4 * p.temporal_sd_dark_stderr_dn[0])
        << seed;
    EXPECT_LT(p.temporal_sd_dark_stderr_dn[0], 0.03 * p.temporal_sd_dark_dn[0]) << seed;
    EXPECT_NEAR(p.K.mean[0], 0.03, 4 * p.K.standard_error[0]) << seed;
    EXPECT_THAT(p.warnings, Not(Contains(HasSubstr("linear")))) << seed;
    EXPECT_THAT(p.warnings, Not(Contains(HasSubstr("straight")))) << seed;
  }
}

// Variance of normal noise about `place` [steps] after rounding.
double rounded_variance(double deviation, double place) {
  const auto below = [&](double edge) { return normal_cdf((edge - place) / deviation); };
  double mean = 0, square = 0;
  for (int code = -8; code <= 9; ++code) {
    const double chance = below(code + 0.5) - below(code - 0.5);
    mean += chance * code;
    square += chance * code * code;
  }
  return square - mean * mean;
}

TEST(RoundedNoise, OfHalfAStepDoubtsTheDarkPointAndDimLevels) {
  Moments over_places;
  constexpr int kPlaces = 64;
  for (int i = 0; i < kPlaces; ++i) over_places.add(rounded_variance(0.5, (i + 0.5) / kPlaces));
  const double truth = std::sqrt(over_places.variance());
  HiddenNoise wide;
  wide.rounding_dn2 = 1.0 / 12;
  DarkPoint dark;
  dark.variance_dn2 = 0.25 + 1.0 / 12;
  std::vector<TransferLevel> levels(2);
  levels[0].variance_dn2 = dark.variance_dn2;
  levels[0].dark_variance_dn2 = dark.variance_dn2;
  levels[0].dark_frames = 2;
  levels[1].variance_dn2 = 1;  // the noise of light hides the codes
  take_hidden_noise(wide, dark, levels);
  EXPECT_NEAR(dark.variance_stderr_dn2, truth, 0.05 * truth);
  EXPECT_NEAR(levels[0].rounding_error_dn2, std::sqrt(2.0) * truth, 0.05 * truth);
  EXPECT_EQ(levels[1].rounding_error_dn2, 0);
}

// Where dark frames of the levels' own hide their noise, all levels have the one dark point: its
// error is in the intercept however many sets there are.
TEST(RoundedNoise, LevelsWithHiddenDarkFramesShareTheErrorOfTheDarkPoint) {
  const auto intercept_error = [](bool own) {
    HiddenNoise hidden;
    hidden.hidden = true;
    hidden.variance_dn2 = 0.04;
    hidden.variance_stderr_dn2 = 0.01;
    hidden.rounding_dn2 = 1.0 / 12;
    hidden.widest_codes_dn2 = 0.3;
    std::vector<TransferLevel> levels;
    for (int i = 1; i <= 8; ++i) {
      TransferLevel level;
      level.mean_dn = 10.0 * i;
      level.variance_dn2 = 0.04 + 1.0 / 12 + 0.05 * level.mean_dn;
      level.frames = 8;
      level.dark_variance_dn2 = 0.02;
      level.dark_frames = own ? 8 : 0;
      level.dark_set = own ? i : 0;
      levels.push_back(level);
    }
    DarkPoint dark;
    dark.pixels = 1 << 14;
    dark.row_groups = 1 << 7;
    take_hidden_noise(hidden, dark, levels);
    return fit_photon_transfer(levels, dark)->intercept_stderr_dn2;
  };
  EXPECT_GT(intercept_error(true), 0.01);
  EXPECT_NEAR(intercept_error(true), intercept_error(false), 1e-6);
}

}  // namespace
}  // namespace malus
