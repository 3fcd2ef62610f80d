// DSNU and PRNU beside defect pixels.
#include "malus/base/statistics.h"
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/equal_values.h"
#include "malus/noise/tukey_lambda.h"

#include "simulated_session.h"
#include <gmock/gmock.h>

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

// A camera whose read noise has this deviation, 20 bias frames.
testing::SimulatedCamera narrow_camera(double read_sd_dn, double dsnu_dn) {
  constexpr double kLambda = 0.14;
  testing::SimulatedCamera camera;
  camera.rows = camera.cols = 128;
  camera.bias_frames = 20;
  camera.flat_levels = 5;
  camera.dsnu_dn = dsnu_dn;
  camera.gains.push_back(testing::polar_gain(0, "mono", 1));
  camera.gains[0].noise.channels[0] = {
      .gain_dn_per_e = 0.1,
      .lambda = kLambda,
      .sigma_tl_dn = read_sd_dn / std::sqrt(tukey_lambda_variance(kLambda)),
      .sigma_row_dn = 0.05};
  return camera;
}

// Rounding makes most dark pixels of such a camera constant: up to a quarter were called stuck.
// One that does not follow the light is a defect all the same.
TEST(Defects, ConstantPixelsOfNarrowNoiseAreNotStuck) {
  for (const double read_sd_dn : {0.15, 0.24, 0.3, 0.4, 0.5})
    for (const double dsnu_dn : {0.0, 0.3}) {
      CalibrationInput input = testing::simulated_session(narrow_camera(read_sd_dn, dsnu_dn));
      testing::change_frames(input, [](RawFrame& frame, int) { frame.dn(8, 9) = 4095; });
      const NoiseModel model = calibrate_physics(input, {}, silent_progress());
      ASSERT_EQ(model.defects.size(), 1u) << read_sd_dn << " DN, DSNU " << dsnu_dn << " DN";
      EXPECT_EQ(model.defects[0].row, 8);
    }
}

// Of wider noise constancy tells by itself, without flats; a pixel that is constant in the dark
// alone, and follows the light, is none.
TEST(Defects, AStuckPixelNeedsNoFlats) {
  for (const int flat_levels : {0, 5}) {
    testing::SimulatedCamera camera = narrow_camera(1.5, 0.3);
    camera.flat_levels = flat_levels;
    CalibrationInput input = testing::simulated_session(camera);
    for (FrameSet& set : input.sets)
      testing::change_frames(set, [kind = set.kind](RawFrame& frame, int) {
        if (kind == FrameKind::kBias) frame.dn(8, 9) = 80;
      });
    const NoiseModel model = calibrate_physics(input, {}, silent_progress());
    ASSERT_EQ(model.defects.size(), flat_levels == 0 ? 1u : 0u);
    if (flat_levels == 0) {
      EXPECT_EQ(model.defects[0].kind, "stuck");
    }
  }
}

// Half a code from the middle at 0.24 codes: 2 Φ(2.08) - 1 = 0.963. Of wide noise 0.282/σ of the
// pairs are equal, and 0.399/σ of the values have the middle code. Where all means lie in the
// middle of a code or at its edge, the chance is not taken for less.
TEST(Defects, TheChanceToStayIsThatOfTheMiddleOfACode) {
  EXPECT_NEAR(chance_to_stay(0.7292), 0.963, 0.002);
  EXPECT_NEAR(chance_to_stay(0.00282), 0.00399, 0.00001);
  EXPECT_EQ(chance_to_stay(1), 1);
  for (const double sd : {0.2, 0.4, 0.7, 1.5})
    for (const double mean : {0.0, 0.25, 0.5}) {
      const auto below = [&](double x) {
        return 0.5 * std::erfc(-(x - mean) / (sd * std::sqrt(2.0)));
      };
      double equal = 0, most = 0;
      for (int code = -20; code <= 20; ++code) {
        const double share = below(code + 0.5) - below(code - 0.5);
        equal += share * share;
        most = std::max(most, share);
      }
      EXPECT_GE(chance_to_stay(equal), most - 0.001) << sd << " about " << mean;
    }
}

TEST(Defects, ManyOfThemAreDoubted) {
  const auto warnings = [](int every) {
    CalibrationInput input = testing::simulated_session(narrow_camera(1.5, 0.3));
    testing::change_frames(input, [every](RawFrame& frame, int) {
      for (int k = 0; k < frame.dn.cols(); k += every)
        for (int r = 0; r < frame.dn.rows(); r += every) frame.dn(r, k) += 60;
    });
    return calibrate_physics(input, {}, silent_progress()).physics.at(0).warnings;
  };
  const auto doubt = ::testing::Contains(::testing::HasSubstr("are listed as defects"));
  EXPECT_THAT(warnings(8), doubt);                   // 1 of 64
  EXPECT_THAT(warnings(16), ::testing::Not(doubt));  // 1 of 256
}

// Bias frames of one channel, 48x48.
testing::SimulatedCamera pattern_camera(double dsnu_dn, double row_dn, int frames,
                                        std::uint64_t seed) {
  testing::SimulatedCamera camera;
  camera.rows = camera.cols = 48;
  camera.dsnu_dn = dsnu_dn;
  camera.bias_frames = frames;
  camera.flat_levels = 0;
  camera.seed = seed;
  camera.gains.push_back(testing::polar_gain(0, "mono", 1));
  camera.gains[0].noise.channels[0] = {
      .gain_dn_per_e = 0.5, .lambda = 0.14, .sigma_tl_dn = 1.2, .sigma_row_dn = row_dn};
  return camera;
}

// Of 200 sessions each, the error over its standard error has a mean square of 1 ± 0.1: below 0.65
// or above 1.35 once in 2000 sets. Rows of 3 DN, of which there are 48, make 2.5 DN from two frames
// uncertain to 0.25 DN; without them it is 0.05.
TEST(FixedPattern, DsnuIsWithinItsStandardError) {
  constexpr int kSessions = 200;
  struct Case {
    double dsnu_dn, row_dn;
    int frames;
  };
  for (const auto& [dsnu_dn, row_dn, frames] :
       {Case{0.5, 0.0, 20}, Case{1.5, 0.3, 2}, Case{2.5, 3.0, 2}, Case{0.5, 3.0, 10}}) {
    Moments squares;
    for (int i = 0; i < kSessions; ++i) {
      const PhysicsCalibration p =
          testing::calibrated(pattern_camera(dsnu_dn, row_dn, frames, static_cast<unsigned>(i)))
              .physics.at(0);
      squares.add(std::pow(p.dsnu_dn.at(0) - dsnu_dn, 2) / std::pow(p.dsnu_stderr_dn.at(0), 2));
    }
    EXPECT_GT(squares.mean(), 0.65) << dsnu_dn << " DN, rows " << row_dn << " DN, " << frames;
    EXPECT_LT(squares.mean(), 1.35) << dsnu_dn << " DN, rows " << row_dn << " DN, " << frames;
  }
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
    testing::SimulatedCamera camera = pattern_camera(kDsnuDn, 0.3, 4, seed);
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

}  // namespace
}  // namespace malus
