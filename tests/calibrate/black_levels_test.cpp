// Frames whose black level is another than that of the highest gain's, or that tell none.
#include "malus/calibrate/calibrate.h"

#include <cmath>
#include <utility>

#include "simulated_session.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using testing::change_frames;
using testing::polar_gain;
using testing::simulated_session;
using testing::SimulatedCamera;

SimulatedCamera camera_at(double gain_db, double black_dn) {
  SimulatedCamera camera;
  camera.black_dn = black_dn;
  camera.bias_frames = 20;
  camera.flat_levels = 6;
  camera.flat_frames = 4;
  camera.gains = {polar_gain(gain_db, "mono", 1)};
  return camera;
}

CalibrationInput both(CalibrationInput first, const CalibrationInput& second) {
  first.sets.insert(first.sets.end(), second.sets.begin(), second.sets.end());
  return first;
}

// Files at 0 dB that tell no black level have that of 24 dB, as their physics results do: dark
// frames and distributions were counted from 0, 64 DN too high.
TEST(BlackLevels, AllKindsCountFromTheSame) {
  CalibrationInput low = simulated_session(camera_at(0, 64));
  change_frames(low, [](RawFrame& frame, int) {
    frame.black_known = false;
    frame.black_dn = {0};
  });
  const NoiseModel model = calibrate(
      both(std::move(low), simulated_session(camera_at(24, 64))), {.level_samples = 5000},
      {ModelKind::kPhysics, ModelKind::kNonparametric, ModelKind::kDarkFrames}, silent_progress());
  ASSERT_EQ(model.black_dn.at(0), 64);
  for (std::size_t gain = 0; gain < 2; ++gain) {
    const double mu = model.physics.at(gain).mu.mean.at(0);
    EXPECT_LT(std::abs(mu), 10) << gain;
    double dark = 0;
    for (const float v : model.dark_frames.at(gain).frames_dn.at(0).values()) dark += v / 4096.0;
    EXPECT_NEAR(dark, mu, 0.5) << gain;
    const NonparametricChannel& levels = model.nonparametric.at(gain).channels.at(0);
    EXPECT_NEAR(level_moments(levels, 0).mean_dn, mu, 0.5) << gain;
    EXPECT_LT(levels.level_dn.back(), 0.85 * (4095 - 64)) << gain;
  }
}

// Codes at 0 stayed behind when their frames were moved to a black level 56 DN higher, and the dark
// deviation was 5.7 DN for one of 3; in the other direction nothing counted as cut off.
TEST(BlackLevels, NoiseCutOffAtZeroIsSoAtTheBlackLevelOfAnotherGain) {
  SimulatedCamera camera = camera_at(0, 8);
  PhysicsChannel& channel = camera.gains[0].noise.channels[0];
  channel.mu_dn = 0;
  channel.sigma_tl_dn = 4.0 / std::sqrt(tukey_lambda_variance(channel.lambda));
  CalibrationInput low = simulated_session(camera);
  change_frames(low, [](RawFrame& frame, int) { frame.bits = 12; });
  const PhysicsCalibration alone = calibrate_physics(low, {}, silent_progress()).physics.at(0);
  EXPECT_NEAR(alone.temporal_sd_dark_dn.at(0), 4.0, 0.1);
  for (const double black_dn : {64.0, 2.0}) {
    const NoiseModel model = calibrate_physics(
        both(low, simulated_session(camera_at(24, black_dn))), {}, silent_progress());
    ASSERT_EQ(model.black_dn.at(0), black_dn);
    const PhysicsCalibration& p = model.physics.at(0);
    EXPECT_NEAR(p.temporal_sd_dark_dn.at(0), alone.temporal_sd_dark_dn[0], 1e-3) << black_dn;
    EXPECT_NEAR(p.mu.mean.at(0), alone.mu.mean.at(0), 1e-3) << black_dn;
    EXPECT_NEAR(p.K.mean.at(0), alone.K.mean.at(0), 1e-4) << black_dn;
    EXPECT_EQ(p.dark_zero_share, alone.dark_zero_share) << black_dn;
    EXPECT_TRUE(p.cut_off_undone) << black_dn;
    EXPECT_THAT(p.warnings, ::testing::Contains(::testing::HasSubstr("dark pixels are 0,")))
        << black_dn;
  }
}

}  // namespace
}  // namespace malus
