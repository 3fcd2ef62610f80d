// DSNU and PRNU beside defect pixels.
#include "malus/calibrate/calibrate.h"

#include "simulated_session.h"
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
    set.load = [load = set.load, kind = set.kind](int i) {
      RawFrame frame = load(i);
      for (int k = 0; k < 16; ++k) {
        frame.dn(8 + 14 * k, 37) += 60.0F + static_cast<float>(k);
        if (kind == FrameKind::kFlat) frame.dn(8 + 14 * k, 181) = 85;
      }
      return frame;
    };
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  const PhysicsCalibration& p = model.physics.at(0);
  EXPECT_EQ(model.defects.size(), 32u);
  EXPECT_NEAR(p.dsnu_dn[0], camera.dsnu_dn, 0.05);
  EXPECT_NEAR(p.prnu[0], camera.prnu, 0.0002);
  EXPECT_LT(p.prnu_map(8, 181), 0.05F);  // the map still shows them
  EXPECT_GT(p.dark_shading_dn(8, 37), 55.0F);
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
    set.load = [load = set.load, kind = set.kind](int i) {
      RawFrame frame = load(i);
      for (int k = 0; k < 12 && kind == FrameKind::kFlat; ++k)
        frame.dn(5 * k, k % 2) = frame.dn(63 - k % 2, 5 * k + 2) = 85;
      return frame;
    };
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  EXPECT_EQ(model.defects.size(), 24u);
  EXPECT_NEAR(model.physics.at(0).prnu.at(0), camera.prnu, 0.0005);  // 4 standard errors of 4096
}

// One pixel of a channel's 256 is more than the thousandth that may be saturated.
TEST(FixedPattern, APixelStuckAtWhiteDoesNotCostTheGain) {
  const testing::SimulatedCamera camera = testing::small_camera();
  CalibrationInput input = testing::simulated_session(camera);
  for (FrameSet& set : input.sets)
    set.load = [load = set.load](int i) {
      RawFrame frame = load(i);
      frame.dn(8, 9) = 4095;
      return frame;
    };
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
  for (FrameSet& set : input.sets)
    set.load = [load = set.load](int i) {
      RawFrame frame = load(i);
      for (int k = 0; k < 5; ++k) frame.dn(k, 3 * k) = 4000.0F;
      return frame;
    };
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  for (const std::string& warning : model.physics[0].warnings)
    EXPECT_EQ(warning.find("light leak"), std::string::npos) << warning;
}

}  // namespace
}  // namespace malus
