// Bias frames of sensors with defects, few of them, and with heavy tails.
#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/internal/bias_checks.h"
#include "malus/calibrate/internal/channel_words.h"
#include "malus/calibrate/internal/coarse_steps.h"
#include "malus/noise/physics.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "simulated_session.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::calibrated;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::polar_gain;
using testing::simulated_session;
using testing::SimulatedCamera;
using testing::small_camera;

// From pixel (3, 5) on, 800 DN too bright in every frame.
void add_hot_pixels(CalibrationInput& input, int every_rows, int every_cols) {
  testing::change_frames(input, [every_rows, every_cols](RawFrame& frame, int) {
    for (int r = 3; r < frame.dn.rows(); r += every_rows)
      for (int c = 5; c < frame.dn.cols(); c += every_cols) frame.dn(r, c) += 800;
  });
}

// One pixel in a hundred that is 800 DN too bright would lift a plain mean by 8 DN.
TEST(BiasFrames, HotPixelsLeaveTheBiasOfTheOthersAlone) {
  const SimulatedCamera camera = small_camera();
  CalibrationInput input = simulated_session(camera);
  add_hot_pixels(input, 10, 10);
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  const PhysicsCalibration& found = model.physics.front();
  const PhysicsNoise& truth = camera.gains.front().noise;
  for (std::size_t c = 0; c < truth.channels.size(); ++c) {
    EXPECT_NEAR(found.mu.mean[c], truth.channels[c].mu_dn, 5 * found.mu.standard_error[c]);
    EXPECT_LT(found.mu.standard_error[c], 0.2);
  }
  double shading = 0;  // what bias and shading together say of an ordinary pixel
  int pixels = 0;
  for (int r = 0; r < found.dark_shading_dn.rows(); ++r)
    for (int c = 0; c < found.dark_shading_dn.cols(); ++c)
      if (r % 10 != 3 || c % 10 != 5) shading += found.dark_shading_dn(r, c), ++pixels;
  EXPECT_NEAR(shading / pixels, 0.0, 1e-3);
}

// The same of one frame alone, of noise so narrow that most pixels have one value too, and of
// frames that are taken one by one.
TEST(BiasFrames, HotPixelsDoNotLiftTheBiasOfSingleFramesEither) {
  for (const double narrow : {1.0, 0.15})
    for (const bool one : {true, false}) {
      SimulatedCamera camera;
      camera.gains.push_back(polar_gain(12, "polar-mono", 1));
      camera.dsnu_dn = 0;
      camera.bias_frames = one ? 1 : 5;
      camera.flat_levels = 0;
      for (PhysicsChannel& channel : camera.gains.front().noise.channels) {
        channel.sigma_tl_dn *= narrow;
        channel.sigma_row_dn *= narrow;
        channel.mu_dn = -2;  // a code: rounding moves no mean
      }
      CalibrationInput input = simulated_session(camera);
      add_hot_pixels(input, 5, 15);
      const NoiseModel model = calibrate_physics(input, {.single_frame = !one}, silent_progress());
      for (const double mu : model.physics.front().mu.mean)  // five standard errors of 1024 pixels
        EXPECT_NEAR(mu, -2.0, 5 * 2.2 * narrow * std::sqrt(1 / 1024.0 + 0.1 / 32) + 0.05) << narrow;
    }
}

// A single value far out in the tail makes a pixel neither noisy nor hot. λ = -0.27 has no fourth
// moment: 1 % of the pixels had four times the median variance over 100 frames.
TEST(BiasFrames, HeavyTailsMakeNoDefects) {
  SimulatedCamera camera;
  camera.rows = camera.cols = 128;
  camera.gains.push_back(polar_gain(12, "polar-mono", 1));
  camera.flat_levels = 0;
  for (PhysicsChannel& channel : camera.gains.front().noise.channels) channel.lambda = -0.27;
  for (const int frames : {4, 20, 100}) {
    camera.bias_frames = frames;
    CalibrationInput input = simulated_session(camera);
    testing::change_frames(input, [](RawFrame& frame, int i) {
      frame.black_dn.assign(4, -1000.0);  // room for large values
      for (float& v : frame.dn.values()) v -= 1080;
      frame.dn(20, 31) += i % 2 ? 600.0F : -600.0F;
      frame.dn(40, 41) += 400;
    });
    const NoiseModel model = calibrate_physics(input, {}, silent_progress());
    // Expected by chance: a twentieth of a pixel per channel, of both kinds.
    EXPECT_LE(model.defects.size(), 2U + 3U) << frames;
    const auto listed = [&](int row, int col, const char* kind) {
      return std::any_of(model.defects.begin(), model.defects.end(), [&](const DefectPixel& d) {
        return d.row == row && d.col == col && d.kind == kind;
      });
    };
    EXPECT_TRUE(listed(20, 31, "noisy")) << frames;
    EXPECT_TRUE(listed(40, 41, "hot")) << frames;
  }
}

// About their mean two frames are mirror images: one of them says all. The standard errors have to
// know it, or they are short by the root of two.
TEST(BiasFrames, TwoBiasFramesClaimNoMoreThanTheyTell) {
  SimulatedCamera camera = small_camera();
  camera.bias_frames = 2;
  camera.flat_levels = 0;
  Moments dark;
  constexpr int kSessions = 12;
  for (int session = 0; session < kSessions; ++session) {
    camera.seed = 100 + static_cast<std::uint64_t>(session);
    CalibrationInput input = simulated_session(camera);
    input.row_group = camera.gains.front().noise.row_group;
    const NoiseModel model = calibrate_physics(input, {}, silent_progress());
    const PhysicsCalibration& found = model.physics.front();
    for (std::size_t c = 0; c < found.sigma_row.mean.size(); ++c) {
      const PhysicsChannel& truth = camera.gains.front().noise.channels[c];
      const double variance =
          truth.sigma_tl_dn * truth.sigma_tl_dn * tukey_lambda_variance(truth.lambda) +
          truth.sigma_row_dn * truth.sigma_row_dn + 1.0 / 12.0;
      dark.add((found.temporal_sd_dark_dn[c] - std::sqrt(variance)) /
               found.temporal_sd_dark_stderr_dn[c]);
    }
  }
  const double rms = std::sqrt(dark.variance() + dark.mean() * dark.mean());
  EXPECT_GT(rms, 0.75);
  EXPECT_LT(rms, 1.25);
}

SimulatedCamera camera_of_shape(double lambda, double sd_dn, double dsnu_dn, int frames) {
  SimulatedCamera camera;
  camera.gains.push_back(polar_gain(0, "polar-mono", 1));
  camera.bias_frames = frames;
  camera.flat_levels = 0;
  camera.dsnu_dn = dsnu_dn;
  for (PhysicsChannel& channel : camera.gains.front().noise.channels) {
    channel.lambda = lambda;
    channel.sigma_tl_dn = sd_dn / std::sqrt(tukey_lambda_variance(lambda));
    channel.sigma_row_dn = 0.05;
  }
  return camera;
}

// Relative errors of σ_TL over sessions and channels, and in standard errors.
struct ScaleErrors {
  Moments relative, z;
};

ScaleErrors scale_errors(SimulatedCamera camera, int sessions) {
  ScaleErrors out;
  for (int i = 0; i < sessions; ++i) {
    camera.seed = 1000 + static_cast<std::uint64_t>(i);
    const ChannelStatistics found = calibrated(camera).physics.front().sigma_tl;
    for (std::size_t c = 0; c < 4; ++c) {
      const double truth = camera.gains.front().noise.channels[c].sigma_tl_dn;
      out.relative.add(found.mean[c] / truth - 1);
      out.z.add((found.mean[c] - truth) / found.standard_error[c]);
    }
  }
  return out;
}

// All pixels at one phase of the lattice: σ_TL was 4.2 % too large when every pixel's own noisy
// mean was its offset. 32 estimates of 1.1 % each: four standard errors of their mean are 0.8 %.
TEST(BiasFrames, NoiseOfHalfAStepWithoutAFixedPatternIsMeasured) {
  const ScaleErrors errors = scale_errors(camera_of_shape(0.14, 0.5, 0.0, 100), 8);
  EXPECT_LT(std::abs(errors.relative.mean()), 0.013);
}

// Noise of 5.9 steps on one lattice beside cells of 5.9 / 24 steps: λ was off by 2.4 stated errors
// (root mean square, which of 12 has a standard deviation of 0.2).
TEST(BiasFrames, TheLatticeOfCodesMakesNoShape) {
  Moments z;
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    SimulatedCamera camera = camera_of_shape(0.14, 5.9, 0.0, 24);
    for (PhysicsChannel& channel : camera.gains.front().noise.channels) channel.sigma_row_dn = 0;
    camera.rows = camera.cols = 256;
    camera.seed = 2000 + seed;
    const ChannelStatistics found = calibrated(camera).physics.front().lambda;
    for (std::size_t c = 0; c < found.mean.size(); ++c)
      z.add((found.mean[c] - 0.14) / found.standard_error[c]);
  }
  EXPECT_LT(std::sqrt(z.variance() + z.mean() * z.mean()), 1.7);
}

// Another frame's value far out in the tail shifts a pixel's mean. 160 estimates: the root mean
// square of z has a standard deviation of 0.06; it was 1.9 from four frames and 1.5 from eight.
TEST(BiasFrames, HeavyTailsFromFewFramesStateTheirError) {
  for (const int frames : {4, 8}) {
    const Moments z = scale_errors(camera_of_shape(-0.27, 3.0, 0.4, frames), 40).z;
    EXPECT_LT(std::sqrt(z.variance() + z.mean() * z.mean()), 1.35) << frames;
  }
}

// The mean of N frames holds a share 1/N of the rows' variance: 4 % of σ_TL too large where there
// is no fixed pattern, and 1 % too small where there is. 48 estimates of 1.4 % each: four standard
// errors of their mean are 0.8 %.
TEST(BiasFrames, RowsAsStrongAsThePixelsLeaveTheScaleAlone) {
  for (const double dsnu : {0.0, 3.0}) {
    SimulatedCamera camera = camera_of_shape(0.14, 3.0, dsnu, 8);
    for (PhysicsChannel& channel : camera.gains.front().noise.channels) channel.sigma_row_dn = 3.0;
    const ScaleErrors errors = scale_errors(camera, 12);
    EXPECT_LT(std::abs(errors.relative.mean()), 0.009) << dsnu;
    EXPECT_LT(std::abs(errors.z.mean()), 0.6) << dsnu;
  }
}

// Columns that are drawn anew in both frames, three times as strong as the pixels: the dark
// deviation's error is theirs.
TEST(BiasFrames, ColumnNoiseIsInTheErrorOfTheDarkDeviation) {
  SimulatedCamera camera = camera_of_shape(0.14, 2.0, 0.0, 2);
  Moments z;
  for (std::uint64_t session = 0; session < 15; ++session) {
    camera.seed = 300 + session;
    CalibrationInput input = simulated_session(camera);
    testing::change_frames(input, [session](RawFrame& frame, int i) {
      for (int c = 0; c < frame.dn.cols(); ++c) {
        const auto index = static_cast<std::uint64_t>(c) << 32 | static_cast<std::uint64_t>(i);
        const double column = 6.0 * testing::internal::normal_at(session, index, 3);
        for (int r = 0; r < frame.dn.rows(); ++r)
          frame.dn(r, c) = static_cast<float>(std::round(frame.dn(r, c) + column));
      }
    });
    input.row_group = 1;
    const NoiseModel model = calibrate_physics(input, {}, silent_progress());
    const PhysicsCalibration& found = model.physics.front();
    const double truth = std::sqrt(4.0 + 36.0 + 0.05 * 0.05 + 2.0 / 12);
    for (std::size_t c = 0; c < 4; ++c)
      z.add((found.temporal_sd_dark_dn[c] - truth) / found.temporal_sd_dark_stderr_dn[c]);
  }
  // Column pairs share their draws: 30 independent estimates, whose root mean square has a standard
  // deviation of 0.13.
  EXPECT_LT(std::sqrt(z.variance() + z.mean() * z.mean()), 1.4);
}

TEST(BiasFrames, HeavyTailsFromFewFramesAreSaid) {
  SimulatedCamera camera = small_camera();
  for (PhysicsChannel& channel : camera.gains.front().noise.channels) channel.lambda = -0.15;
  camera.bias_frames = 4;
  EXPECT_THAT(calibrated(camera).physics.front().warnings, Contains(HasSubstr("heavy tails")));
  camera.bias_frames = 20;
  EXPECT_THAT(calibrated(camera).physics.front().warnings, Not(Contains(HasSubstr("heavy tails"))));
  for (PhysicsChannel& channel : camera.gains.front().noise.channels) channel.lambda = 0.2;
  camera.bias_frames = 4;
  EXPECT_THAT(calibrated(camera).physics.front().warnings, Not(Contains(HasSubstr("heavy tails"))));
}

enum class AddedNoise { kNone, kLaplace, kTelegraph };

// Read noise of 4 DN. kTelegraph: one pixel in 150 jumps by 48 DN in a tenth of the frames.
PhysicsCalibration of_added_noise(AddedNoise noise, std::uint64_t seed) {
  constexpr double kReadDn = 4.0, kJump = 48.0, kOneInTen = 1.2816;
  const bool laplace = noise == AddedNoise::kLaplace;
  SimulatedCamera camera = testing::mono_camera(0.4, 0.14, laplace ? 0.01 : kReadDn, 0.3, seed);
  camera.rows = camera.cols = 96;
  camera.bias_frames = 24;
  camera.rounded = false;
  CalibrationInput input = simulated_session(camera);
  testing::change_frames(input, [noise, seed](RawFrame& frame, int i) {
    RandomSequence random(seed, static_cast<std::uint32_t>(i), Draw::kScene);
    std::size_t pixel = 0;
    for (float& dn : frame.dn.values()) {
      const double size = kReadDn * std::hypot(random.normal(), random.normal());
      const double drawn = random.normal();
      if (noise == AddedNoise::kLaplace)
        dn += static_cast<float>(size * drawn / std::numbers::sqrt2);
      else if (noise == AddedNoise::kTelegraph && pixel++ % 150 == 7 && drawn > kOneInTen)
        dn += static_cast<float>(kJump);
      dn = std::round(dn);
    }
  });
  return calibrate_physics(input, {}, silent_progress()).physics.front();
}

// Laplace noise is likeliest of the law with λ = -0.18, whose deviation is 4 % larger, 11 stated
// errors of σ_TL. Pixels that jump make the frames' variance larger: there the law is right.
TEST(BiasFrames, TheLawHasTheDarkFramesVariance) {
  constexpr double kReadDn = 4.0;
  for (const std::uint64_t seed : {5, 6, 7}) {
    const PhysicsCalibration laplace = of_added_noise(AddedNoise::kLaplace, seed);
    EXPECT_NEAR(laplace.lambda.mean.at(0), -0.18, 0.01);
    EXPECT_NEAR(read_noise_dn(laplace)[0] / kReadDn, 1.0, 0.012);
    // What is kept of single frames is the mean's: errors in electrons come from them.
    double of_frames = 0;
    for (const auto& frame : laplace.sigma_tl.per_frame) of_frames += frame[0] / 24;
    EXPECT_NEAR(of_frames / laplace.sigma_tl.mean[0], 1.0, 1e-9);
    for (const AddedNoise noise : {AddedNoise::kNone, AddedNoise::kTelegraph})
      EXPECT_NEAR(read_noise_dn(of_added_noise(noise, seed))[0] / kReadDn, 1.0, 0.008);
  }
}

// Of t-distributed noise of 4 degrees of freedom, whose tails no Tukey-lambda law has, the read
// noise is 2 % too small: 6 to 10 errors of σ_TL.
TEST(BiasFrames, ReadNoiseOfTailsThatNoLawHasIsWithinItsError) {
  constexpr double kReadDn = 4;
  testing::SimulatedCamera camera = testing::mono_camera(0.5, 0.1, 0.5, 0, 3);
  camera.rows = camera.cols = 128;
  camera.flat_levels = 0;
  camera.rounded = false;
  CalibrationInput input = testing::simulated_session(camera);
  testing::change_frames(input, [](RawFrame& frame, int i) {
    RandomSequence random(3, static_cast<std::uint32_t>(i), Draw::kOther);
    for (float& v : frame.dn.values()) {
      double squares = 0;
      for (int k = 0; k < 4; ++k) squares += std::pow(random.normal(), 2) / 4;
      v = static_cast<float>(
          std::round(v + kReadDn / std::numbers::sqrt2 * random.normal() / std::sqrt(squares)));
    }
  });
  const PhysicsCalibration p = calibrate_physics(input, {}, silent_progress()).physics.at(0);
  const double truth = std::hypot(kReadDn, 0.5), found = read_noise_dn(p)[0];
  EXPECT_LT(found, 0.99 * truth);
  EXPECT_NEAR(found / truth, 1, 2 * p.sigma_tl.standard_error[0] / p.sigma_tl.mean[0]);
}

// Dark noise of one channel with that shape and deviation, steps of 1 DN.
std::size_t warnings_of_steps(double lambda, double sd_dn, double row_dn) {
  PhysicsCalibration dark;
  dark.temporal_sd_dark_dn = {std::hypot(sd_dn, row_dn)};
  dark.lambda.mean = {lambda};
  dark.sigma_tl.mean = {sd_dn / std::sqrt(tukey_lambda_variance(lambda))};
  dark.sigma_row.mean = {row_dn};
  warn_of_coarse_steps(1.0, dark);
  return dark.warnings.size();
}

TEST(BiasFrames, NoiseTooNarrowForTheStepIsSaid) {
  // λ = 0.14 is all but normal: half a step is the limit.
  EXPECT_EQ(warnings_of_steps(0.14, 0.45, 0), 1U);
  EXPECT_EQ(warnings_of_steps(0.14, 0.55, 0), 0U);
  // λ = 0 is logistic: x / sinh x, x = 2√3 π sd, comes down to exp(-π²/2) at 0.704 steps.
  EXPECT_EQ(warnings_of_steps(0, 0.69, 0), 1U);
  EXPECT_EQ(warnings_of_steps(0, 0.72, 0), 0U);
  // A narrow core with wide tails; rows that differ by half a step dither it.
  EXPECT_EQ(warnings_of_steps(-0.27, 0.91, 0), 1U);
  EXPECT_EQ(warnings_of_steps(-0.27, 0.91, 0.5), 0U);
  EXPECT_EQ(warnings_of_steps(-0.27, 3, 0), 0U);
}

// Quantiles that lie steps apart said that thousands of DN were too narrow.
TEST(BiasFrames, WideNoiseIsNeverTooNarrowForTheStep) {
  for (const double lambda : {-0.3, 0.0, 0.14, 0.9, 1.5, 2.0})
    for (double sd_dn = 8; sd_dn < 1e5; sd_dn *= 1.07)
      EXPECT_EQ(warnings_of_steps(lambda, sd_dn, 0), 0U) << lambda << ' ' << sd_dn;
}

TEST(ChannelTroubles, ThatDifferInNumbersShareALine) {
  const SensorLayout layout = SensorLayout::named("bayer-rggb");
  ChannelTroubles troubles;
  troubles.add("R", "it is -0.25 ± 1e-3 DN (EMVA 1288)");
  troubles.add("G1", "something else");
  troubles.add("B", "it is -10 ± 2e-3 DN (EMVA 1288)");
  EXPECT_THAT(
      troubles.lines(layout),
      ElementsAre("R, B: it is -10 to -0.25 ± 1e-3 to 2e-3 DN (EMVA 1288)", "G1: something else"));
  EXPECT_EQ(channels_text({"R", "G1", "G2", "B"}, layout), "all 4 channels");
  EXPECT_EQ(channels_text({"mono"}, SensorLayout::named("mono")), "mono");
}

TEST(BiasFrames, ChannelsWithTheSameTroubleShareALine) {
  SimulatedCamera camera;
  camera.bias_frames = 6;
  camera.flat_levels = 4;
  camera.gains.push_back(testing::polar_gain(12));
  for (PhysicsChannel& channel : camera.gains.front().noise.channels) {
    channel.sigma_tl_dn = 0.12;
    channel.sigma_row_dn = 0;
  }
  const NoiseModel model = calibrated(camera);
  std::vector<std::string> lines;
  for (const std::string& line : model.physics.front().warnings)
    if (line.find("is hidden by the converter") != std::string::npos) lines.push_back(line);
  // Known of some channels, of some not: two lines, not 16.
  EXPECT_GE(lines.size(), 1U);
  EXPECT_LE(lines.size(), 2U);
}

}  // namespace
}  // namespace malus
