// DSNU and PRNU beside defect pixels.
#include "malus/calibrate/calibrate.h"
#include "malus/noise/tukey_lambda.h"

#include "pattern_sessions.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// Sixteen hot and sixteen dead pixels of 65536 were once most of both.
TEST(FixedPattern, DefectsAreNoPartOfDsnuAndPrnu) {
  testing::SimulatedCamera camera;
  camera.rows = camera.cols = 256;
  camera.bias_frames = 30;
  camera.flat_frames = 12;
  camera.flat_levels = 6;
  camera.dsnu_dn = 0.4;
  camera.prnu = 0.006;
  camera.gains.push_back(testing::polar_gain(12, "mono", 1));
  CalibrationInput input = testing::simulated_session(camera);
  for (FrameSet& set : input.sets)
    testing::change_frames(set, [kind = set.kind](RawFrame& frame, int) {
      for (int k = 0; k < 16; ++k) {
        frame.dn(8 + 14 * k, 37) += 60.0F + static_cast<float>(k);
        if (kind == FrameKind::kFlat) frame.dn(8 + 14 * k, 181) = 85;
      }
    });
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  const PhysicsCalibration& p = model.physics.at(0);
  EXPECT_EQ(model.defects.size(), 32u);
  EXPECT_NEAR(p.dsnu_dn[0], camera.dsnu_dn, 0.05);
  EXPECT_NEAR(p.prnu[0], camera.prnu, 0.0002);
  EXPECT_LT(p.prnu_map(8, 181), 0.05F);  // the map still shows them
  EXPECT_GT(p.dark_shading_dn(8, 37), 55.0F);
}

// Sixteen telegraph pixels of 16384 made 2.1 DN of 1.6 of dark noise, and 0.1 of 0.5 of DSNU.
TEST(FixedPattern, TelegraphPixelsAreNoPartOfTheDarkNoise) {
  testing::SimulatedCamera camera;
  camera.rows = camera.cols = 128;
  camera.bias_frames = 10;
  camera.dsnu_dn = 0.5;
  camera.gains.push_back(testing::polar_gain(12, "mono", 1));
  CalibrationInput input = testing::simulated_session(camera);
  const NoiseModel without = calibrate_physics(input, {}, silent_progress());
  testing::change_frames(input, [](RawFrame& frame, int i) {
    for (int k = 0; k < 16; ++k) frame.dn(4 + 7 * k, 37) += (i * 7 + k * 3) % 5 < 2 ? 150.0F : 0.0F;
  });
  const NoiseModel with = calibrate_physics(input, {}, silent_progress());
  EXPECT_EQ(with.defects.size(), without.defects.size() + 16);
  const PhysicsCalibration &p = with.physics.at(0), &q = without.physics.at(0);
  EXPECT_NEAR(p.temporal_sd_dark_dn[0] / q.temporal_sd_dark_dn[0], 1.0, 0.005);
  EXPECT_NEAR(p.dsnu_dn[0], q.dsnu_dn[0], 0.01);
  EXPECT_NEAR(p.dsnu_dn[0], camera.dsnu_dn, 0.05);
}

// Row noise of ten deviations of a pixel leaves a spread of 5 DN² of rows in the mean of 20 frames,
// beside 0.16 or 1 DN² of pattern: taken for the pixels', it made the read noise up to a quarter
// too large. Row noise that was 1 % too small made it 2 % too small.
TEST(FixedPattern, StrongRowNoiseIsNotTakenForPixelsOffsets) {
  for (const double dsnu_dn : {0.4, 1.0})
    for (std::uint64_t seed = 0; seed < 8; ++seed) {
      testing::SimulatedCamera camera = testing::mono_camera(0.36, 0.14, 1.0, 10.0, seed);
      camera.rows = camera.cols = 128;
      camera.dsnu_dn = dsnu_dn;
      camera.flat_levels = 0;
      const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
      const double truth = camera.gains[0].noise.channels[0].sigma_tl_dn;
      EXPECT_NEAR(p.sigma_tl.mean[0] / truth, 1.0, 0.01) << dsnu_dn << " DN, " << seed;
    }
}

// Listed for their noise, their means lie among the others': DSNU kept a tenth of their variance
// and was 0.35 DN of 0.3. The standard error of DSNU is 0.005 DN.
TEST(FixedPattern, TelegraphPixelsAreNoPartOfTheDsnu) {
  for (const char* layout : {"mono", "polar-bayer-rggb"}) {
    testing::SimulatedCamera camera;
    camera.rows = camera.cols = 128;
    camera.bias_frames = 10;
    camera.flat_levels = 0;
    camera.dsnu_dn = 0.3;
    camera.gains.push_back(testing::polar_gain(0, layout, 1));
    CalibrationInput input = testing::simulated_session(camera);
    testing::change_frames(input, [](RawFrame& frame, int i) {
      for (int k = 0; k < 150; ++k) {
        const auto draw = static_cast<std::uint64_t>(1000 * i + k);
        frame.dn(k % 5 * 25 + k / 30 * 3, k * 7 % 128) +=
            testing::internal::normal_at(1, draw, 7) > 0 ? 8.0F : -8.0F;
      }
    });
    const NoiseModel model = calibrate_physics(input, {}, silent_progress());
    EXPECT_GE(model.defects.size(), 145u);
    EXPECT_NEAR(mean_of(model.physics.at(0).dsnu_dn), camera.dsnu_dn, 0.02) << layout;
  }
}

// From 2 bias frames of 10 DN the PRNU was a third too large: their mean's error is in every level.
// 16384 pixels: half a per cent each for the response and its error, which is twice the PRNU
// squared.
TEST(FixedPattern, TheDarkFramesErrorIsNoResponse) {
  testing::SimulatedCamera camera;
  camera.rows = camera.cols = 128;
  camera.flat_frames = 20;
  camera.flat_levels = 6;
  camera.prnu = 0.005;
  camera.gains.push_back(testing::polar_gain(0, "mono", 1));
  camera.gains[0].noise.channels[0] = {
      .gain_dn_per_e = 0.5, .lambda = 0.14, .sigma_tl_dn = 6.8, .sigma_row_dn = 0.5};
  for (const int frames : {2, 5}) {
    camera.bias_frames = frames;
    EXPECT_NEAR(testing::calibrated(camera).physics.at(0).prnu.at(0), camera.prnu, 0.00015)
        << frames;
  }
}

// Windows at the border are small, and a dead pixel was a ninth of its neighbours'.
TEST(FixedPattern, DeadPixelsAtTheBorderAreNoPrnu) {
  testing::SimulatedCamera camera;
  camera.bias_frames = 20;
  camera.flat_frames = 20;
  camera.flat_levels = 4;
  camera.gains.push_back(testing::polar_gain(12, "mono", 1));
  CalibrationInput input = testing::simulated_session(camera);
  for (FrameSet& set : input.sets)
    testing::change_frames(set, [kind = set.kind](RawFrame& frame, int) {
      for (int k = 0; k < 12 && kind == FrameKind::kFlat; ++k)
        frame.dn(5 * k, k % 2) = frame.dn(63 - k % 2, 5 * k + 2) = 85;
    });
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  EXPECT_EQ(model.defects.size(), 24u);
  EXPECT_NEAR(model.physics.at(0).prnu.at(0), camera.prnu, 0.0005);  // 4 standard errors of 4096
}

// The window of a dead corner had no sound pixel in the second round, and the corner was taken for
// sound again: one made 1.9 % of 1 %. Clusters and rows at the border pulled the light's polynomial
// down to theirs: 1.6, 3.2 and 4.9 %, and most of their pixels were not listed.
TEST(FixedPattern, DeadCornersAndClustersAtTheBorderAreNoPrnu) {
  testing::SimulatedCamera camera;
  camera.bias_frames = 20;
  camera.flat_frames = 6;
  camera.flat_levels = 5;
  camera.gains.push_back(testing::polar_gain(0, "mono", 1));
  struct Rectangle {
    int row, col, rows, cols;
  };
  for (const Rectangle& dead :
       {Rectangle{0, 0, 1, 1}, Rectangle{63, 63, 1, 1}, Rectangle{0, 0, 4, 4},
        Rectangle{63, 0, 1, 32}, Rectangle{0, 20, 3, 6}}) {
    CalibrationInput input = testing::simulated_session(camera);
    for (FrameSet& set : input.sets)
      testing::change_frames(set, [kind = set.kind, dead](RawFrame& frame, int) {
        for (int r = 0; r < dead.rows && kind == FrameKind::kFlat; ++r)
          for (int c = 0; c < dead.cols; ++c) frame.dn(dead.row + r, dead.col + c) = 85;
      });
    const NoiseModel model = calibrate_physics(input, {}, silent_progress());
    EXPECT_EQ(model.defects.size(), static_cast<std::size_t>(dead.rows * dead.cols));
    EXPECT_NEAR(model.physics.at(0).prnu.at(0), camera.prnu, 0.0005) << dead.rows << dead.cols;
  }
}

// One pixel of a channel's 256 is more than the thousandth that may be saturated.
TEST(FixedPattern, APixelStuckAtWhiteDoesNotCostTheGain) {
  const testing::SimulatedCamera camera = testing::small_camera();
  CalibrationInput input = testing::simulated_session(camera);
  testing::change_frames(input, [](RawFrame& frame, int) { frame.dn(8, 9) = 4095; });
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  const ChannelStatistics& K = model.physics.at(0).K;
  ASSERT_EQ(K.mean.size(), 16u);
  for (std::size_t c = 0; c < 16; ++c)
    EXPECT_NEAR(K.mean[c], camera.gains[0].noise.channels[c].gain_dn_per_e,
                4 * K.standard_error[c]);
}

// All of them in one corner of the frame.
TEST(FixedPattern, HotPixelsAreNoLightLeak) {
  testing::SimulatedCamera camera;
  camera.rows = camera.cols = 64;
  camera.bias_frames = 30;
  camera.flat_levels = 0;
  camera.gains.push_back(testing::polar_gain(12, "mono", 1));
  CalibrationInput input = testing::simulated_session(camera);
  testing::change_frames(input, [](RawFrame& frame, int) {
    for (int k = 0; k < 5; ++k) frame.dn(k, 3 * k) = 4000.0F;
  });
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  for (const std::string& warning : model.physics[0].warnings)
    EXPECT_EQ(warning.find("light leak"), std::string::npos) << warning;
}

// The mean square of 20 sessions spreads by 0.3; with 100: fixed_pattern_slow_test.cpp.
TEST(FixedPattern, DsnuAndBiasAreWithinTheirStandardErrors) {
  testing::expect_stated_errors_of_patterns(20, 0.2, 2.5);
}

// Of heavy tails a single value moves a pixel's mean so far that it is left out, and with it goes
// its part of the temporal noise: DSNU of 0.4 DN was 0.11 on the mean of such sessions and sigma_TL
// 4 % too large, by 4 of its errors.
TEST(FixedPattern, HeavyTailsOfFewFramesDoNotHideIt) {
  constexpr double kLambda = -0.27, kReadDn = 3, kDsnuDn = 0.4;
  constexpr int kSessions = 8;
  const double scale_dn = kReadDn / std::sqrt(tukey_lambda_variance(kLambda));
  double dsnu = 0, sigma_tl = 0, error = 0;
  for (unsigned seed = 1; seed <= kSessions; ++seed) {
    testing::SimulatedCamera camera = testing::pattern_camera(kDsnuDn, 0.3, 4, seed);
    camera.rows = camera.cols = 128;
    camera.gains[0].noise.channels[0].lambda = kLambda;
    camera.gains[0].noise.channels[0].sigma_tl_dn = scale_dn;
    const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
    dsnu += p.dsnu_dn.at(0) / kSessions;
    sigma_tl += p.sigma_tl.mean.at(0) / kSessions;
    error += p.sigma_tl.standard_error.at(0) / kSessions;
  }
  EXPECT_NEAR(dsnu, kDsnuDn, 0.1);
  EXPECT_NEAR(sigma_tl, scale_dn, 5 * error / std::sqrt(kSessions));
}

std::string said_in_one(const PhysicsCalibration& p) {
  std::string all;
  for (const std::string& said : p.warnings) all += said + "\n";
  return all;
}

// Columns that differ, and the DSNU of a frame of few pixels: eight of ten and a third of such
// sessions had a light leak.
TEST(FixedPattern, ThatIsUnlikeByChanceIsNoLightLeak) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    testing::SimulatedCamera camera = testing::pattern_camera(0.5, 0.3, 10, seed);
    const std::string columns = said_in_one(testing::with_fixed_columns(camera, 1.5));
    EXPECT_EQ(columns.find("light leak"), std::string::npos) << columns;
    camera.rows = 12, camera.cols = 16;
    camera.dsnu_dn = 1.0;
    const std::string few = said_in_one(testing::calibrated(camera).physics.at(0));
    EXPECT_EQ(few.find("light leak"), std::string::npos) << few;
  }
}

// Beside all that a glow is told.
TEST(FixedPattern, DoesNotHideALightLeak) {
  CalibrationInput input = testing::simulated_session(testing::pattern_camera(0.5, 0.3, 10, 1));
  testing::change_frames(input, [](RawFrame& frame, int) {
    for (int r = 0; r < 48; ++r)
      for (int c = 0; c < 48; ++c) frame.dn(r, c) += std::round(0.06F * static_cast<float>(r));
  });
  const std::string all =
      said_in_one(calibrate_physics(input, {}, silent_progress()).physics.at(0));
  EXPECT_NE(all.find("light leak"), std::string::npos) << all;
}

}  // namespace
}  // namespace malus
