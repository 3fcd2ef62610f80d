#include "malus/calibrate/gaussian_calibration.h"

#include <cmath>

#include "simulated_session.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// Noise that falls with the light is chance: the line is level then, at the weighted mean.
TEST(GaussianCalibration, LinesNeverFall) {
  MeasuredLevels measured;
  measured.distributions.gain.gain_db = 0;
  measured.row_variance_dn2 = {0.5, 0.5};
  measured.row_variance_stderr_dn2 = {0.1, 0.1};
  measured.bias_dn = {0, 0};
  measured.noise = {{{0, 4.2, 4000}, {10, 4.0, 2000}, {20, 3.9, 2000}},
                    {{0, 4.0, 4000}, {10, 4.5, 2000}, {20, 5.0, 2000}}};
  const auto line = gaussian_of(measured, 100);
  ASSERT_TRUE(line);
  EXPECT_EQ(line->slope_dn[0], 0);
  // Equal variances on the line: the levels weigh by their freedom alone.
  EXPECT_NEAR(line->offset_dn2[0], (2 * 4.2 + 4.0 + 3.9) / 4 + 0.5, 1e-9);
  // Weights 0.5 f / 4.075², 240.9 in all; χ² about the mean 4.065 of one degree of freedom.
  EXPECT_NEAR(line->offset_stderr_dn2[0], std::hypot(std::sqrt(4.065 / 240.9), 0.1), 1e-4);
  EXPECT_NEAR(line->slope_dn[1], 0.05, 1e-9);
  EXPECT_NEAR(line->offset_dn2[1], 4.5, 1e-9);
}

// One channel's noise is hidden by the converter's step; the others' was taken with the noise of
// their defects, 0.80 to 0.84 DN² for 0.57.
TEST(GaussianCalibration, DefectsAreNotInItBesideAChannelOfHiddenNoise) {
  testing::SimulatedCamera camera;
  camera.rows = camera.cols = 128;
  camera.bias_frames = 20;
  camera.flat_levels = 6;
  camera.flat_frames = 4;
  camera.dsnu_dn = 0.15;
  camera.black_dn = 20;
  camera.white_dn = 255;
  camera.gains = {testing::polar_gain(0, "polar-mono", 1)};
  PhysicsNoise& noise = camera.gains[0].noise;
  for (PhysicsChannel& channel : noise.channels) {
    channel = {.gain_dn_per_e = 0.1, .lambda = 0.14, .sigma_row_dn = 0};
    const double read_dn = &channel == &noise.channels.front() ? 0.25 : 0.7;
    channel.sigma_tl_dn = read_dn / std::sqrt(tukey_lambda_variance(channel.lambda));
  }
  CalibrationInput input = testing::simulated_session(camera);
  testing::change_frames(input, [](RawFrame& frame, int i) {
    for (int r = 1; r < frame.dn.rows(); r += 32)
      for (int c = 1; c < frame.dn.cols(); c += 16) frame.dn(r, c) += i % 2 ? 12.0F : -12.0F;
  });
  const NoiseModel model =
      calibrate(input, {}, {ModelKind::kPhysics, ModelKind::kGaussian}, silent_progress());
  const PhysicsCalibration& p = model.physics.at(0);
  const GaussianCalibration& gaussian = model.gaussian.at(0);
  EXPECT_GT(model.defects.size(), 20u);
  EXPECT_NEAR(gaussian.offset_dn2.at(0), 0.25 * 0.25 + 1.0 / 12, 4 * gaussian.offset_stderr_dn2[0]);
  EXPECT_NE(gaussian.offset_dn2[0], std::pow(p.temporal_sd_dark_dn[0], 2));
  for (std::size_t c = 1; c < 4; ++c) {
    EXPECT_DOUBLE_EQ(gaussian.offset_dn2[c], std::pow(p.temporal_sd_dark_dn[c], 2));
    EXPECT_DOUBLE_EQ(gaussian.offset_stderr_dn2[c],
                     2 * p.temporal_sd_dark_dn[c] * p.temporal_sd_dark_stderr_dn[c]);
    EXPECT_NEAR(gaussian.offset_dn2[c], 0.49 + 1.0 / 12, 0.03) << c;
  }
}

}  // namespace
}  // namespace malus
