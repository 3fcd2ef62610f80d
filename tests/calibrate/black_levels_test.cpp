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

}  // namespace
}  // namespace malus
