// Bursts with reference frames that have noise of their own.
#include "malus/base/statistics.h"
#include "malus/calibrate/calibrate.h"

#include <cmath>

#include "simulated_session.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::polar_gain;
using testing::ramp_frame;

constexpr double kReferenceLight = 0.7;  // of the burst's

// A ramp, as a burst and as references with a quarter of its noise's variance at the same signal.
struct RampSession {
  PhysicsNoise noise = polar_gain(12, "mono", 1).noise;
  int size = 160, frames = 10, references = 1;
  std::uint64_t seed = 3;

  RawFrame frame(const PhysicsNoise& of, double light, std::uint32_t index,
                 std::uint64_t own_seed) const {
    return ramp_frame(of, light * 2600, size, DrawAddress{own_seed, index, 0, 0}, true);
  }
  CalibrationInput input() const {
    FrameSet burst, reference;
    burst.kind = FrameKind::kBurst;
    burst.gain.iso = 1600;
    burst.count = frames;
    burst.load = [s = *this](int i) {
      return s.frame(s.noise, 1.0, static_cast<std::uint32_t>(i), s.seed);
    };
    PhysicsNoise quiet = noise;
    quiet.channels[0].gain_dn_per_e *= 0.25 * kReferenceLight;
    quiet.channels[0].sigma_tl_dn *= 0.5 * kReferenceLight;
    quiet.channels[0].sigma_row_dn *= 0.5 * kReferenceLight;
    reference.kind = FrameKind::kReference;
    reference.gain.iso = 400;
    reference.count = references;
    reference.load = [s = *this, quiet](int i) {
      return s.frame(quiet, kReferenceLight, static_cast<std::uint32_t>(i), s.seed + 1000);
    };
    CalibrationInput out;
    out.sets = {burst};
    if (references > 0) out.sets.push_back(reference);
    return out;
  }
};

CalibrationSettings few_samples() {
  CalibrationSettings settings;
  settings.level_samples = 5000;
  return settings;
}

// A reference's own noise was once taken for the burst's: up to a quarter of the variance here.
TEST(ReferenceFrames, TheirNoiseIsNotTheBursts) {
  for (const int frames : {2, 4, 20}) {
    const NoiseModel without =
        calibrate(RampSession{.frames = frames, .references = 0}.input(), few_samples(),
                  {ModelKind::kNonparametric}, silent_progress());
    for (const int references : {1, 2, 20}) {
      RampSession session{.frames = frames, .references = references};
      const PhysicsChannel& truth = session.noise.channels[0];
      const NoiseModel model =
          calibrate(session.input(), few_samples(),
                    {ModelKind::kGaussian, ModelKind::kNonparametric}, silent_progress());
      const GaussianCalibration& g = model.gaussian.at(0);
      EXPECT_NEAR(g.slope_dn[0], truth.gain_dn_per_e, 4 * g.slope_stderr_dn[0])
          << frames << " " << references;
      EXPECT_LT(g.slope_stderr_dn[0], 0.03 * truth.gain_dn_per_e);
      // Bright pixels hide the rows; a reference neither helps nor harms.
      EXPECT_NEAR(std::pow(model.nonparametric[0].sigma_row_dn[0], 2),
                  std::pow(without.nonparametric[0].sigma_row_dn[0], 2), 0.02);
      // All levels together: each has an error of its own.
      const NonparametricChannel& channel = model.nonparametric[0].channels[0];
      double ratio = 0;
      for (std::size_t l = 0; l < channel.level_dn.size(); ++l)
        ratio += level_moments(channel, l).variance_dn2 /
                 (pixel_variance_dn2(truth, channel.level_dn[l], 1.0) *
                  static_cast<double>(channel.level_dn.size()));
      EXPECT_NEAR(ratio, 1.0, 0.01 + 4 * std::sqrt(2.0 / (25600.0 * (frames - 1))))
          << frames << " " << references;
    }
  }
}

// 60 sessions: the variance of z has a standard deviation of 0.18, its mean one of 0.13.
TEST(ReferenceFrames, StatedErrorsHold) {
  constexpr int kSessions = 60;
  for (const int frames : {2, 10}) {
    Moments slope, offset;
    for (std::uint64_t i = 0; i < kSessions; ++i) {
      RampSession session{.size = 64, .frames = frames, .references = 2, .seed = 50 + i};
      const PhysicsChannel& truth = session.noise.channels[0];
      const NoiseModel model = calibrate(session.input(), {.level_samples = 500},
                                         {ModelKind::kGaussian}, silent_progress());
      const GaussianCalibration& g = model.gaussian.at(0);
      slope.add((g.slope_dn[0] - truth.gain_dn_per_e) / g.slope_stderr_dn[0]);
      offset.add((g.offset_dn2[0] - pixel_variance_dn2(truth, 0, 1.0) -
                  truth.sigma_row_dn * truth.sigma_row_dn) /
                 g.offset_stderr_dn2[0]);
    }
    for (const Moments& z : {slope, offset}) {
      EXPECT_LT(z.variance(), 1.0 + 4 * std::sqrt(2.0 / kSessions)) << frames;
      EXPECT_GT(z.variance(), 0.4) << frames;
      EXPECT_LT(std::abs(z.mean()), 0.6) << frames;
    }
  }
}

// Both sets have the bias of the camera; bias frames tell the burst's, and where its signal is
// zero.
TEST(ReferenceFrames, TheirDarkBiasMovesNoLevel) {
  RampSession session{.frames = 20, .references = 4};
  session.noise.channels[0].mu_dn = 8;
  CalibrationInput input = session.input();
  FrameSet bias = input.sets[0];
  bias.kind = FrameKind::kBias;
  bias.load = [session](int i) {
    return session.frame(session.noise, 0.0, static_cast<std::uint32_t>(i), session.seed + 2000);
  };
  input.sets.push_back(bias);
  const NoiseModel model =
      calibrate(input, few_samples(), {ModelKind::kGaussian}, silent_progress());
  const GaussianCalibration& g = model.gaussian.at(0);
  const PhysicsChannel& truth = session.noise.channels[0];
  EXPECT_NEAR(g.offset_dn2[0],
              pixel_variance_dn2(truth, 0, 1.0) + truth.sigma_row_dn * truth.sigma_row_dn,
              4 * g.offset_stderr_dn2[0]);
  EXPECT_LT(4 * g.offset_stderr_dn2[0], 8 * truth.gain_dn_per_e);
}

// Another scene in a part, with hot pixels: what is left is still the burst's noise.
TEST(ReferenceFrames, AReferenceThatMovedDoesNoHarm) {
  RampSession session{.frames = 8, .references = 4};
  CalibrationInput input = session.input();
  testing::change_frames(input.sets[1], [](RawFrame& frame, int) {
    for (int r = 0; r < frame.dn.rows(); ++r)
      for (int c = 0; c < frame.dn.cols(); ++c) {
        if (r > 60 && c > 60 && r < 100 && c < 100) frame.dn(r, c) += 40;
        if ((r * 7 + c) % 501 == 0) frame.dn(r, c) += 200;
      }
  });
  const NoiseModel model = calibrate(
      input, few_samples(), {ModelKind::kGaussian, ModelKind::kNonparametric}, silent_progress());
  const GaussianCalibration& g = model.gaussian.at(0);
  const PhysicsChannel& truth = session.noise.channels[0];
  EXPECT_NEAR(g.slope_dn[0], truth.gain_dn_per_e, 4 * g.slope_stderr_dn[0]);
}

}  // namespace
}  // namespace malus
