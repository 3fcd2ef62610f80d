#include "malus/base/statistics.h"
#include "malus/calibrate/calibrate.h"

#include <cmath>
#include <string>
#include <vector>

#include "simulated_session.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::polar_gain;
using testing::polar_mono_camera;
using testing::ramp_frame;
using testing::simulated_session;
using testing::SimulatedCamera;

CalibrationSettings small_levels() {
  CalibrationSettings settings;
  settings.level_samples = 10000;
  return settings;
}

double pixel_variance(const PhysicsChannel& c, double signal_dn) {
  return pixel_variance_dn2(c, signal_dn, 1.0);
}

TEST(CalibrateKinds, GaussianIsTheLineOfTheWholeVariance) {
  const SimulatedCamera camera = polar_mono_camera();
  const NoiseModel model =
      calibrate(simulated_session(camera), {}, {ModelKind::kGaussian}, silent_progress());
  EXPECT_THAT(model.kinds(), ::testing::ElementsAre(ModelKind::kGaussian));
  ASSERT_EQ(model.gaussian.size(), 1u);
  const GaussianCalibration& g = model.gaussian[0];
  for (std::size_t c = 0; c < 4; ++c) {
    const PhysicsChannel& truth = camera.gains[0].noise.channels[c];
    const double offset = pixel_variance(truth, 0) + truth.sigma_row_dn * truth.sigma_row_dn;
    EXPECT_NEAR(g.slope_dn[c], truth.gain_dn_per_e, 4 * g.slope_stderr_dn[c]);
    EXPECT_NEAR(g.offset_dn2[c], offset, 4 * g.offset_stderr_dn2[c]);
    EXPECT_NEAR(g.bias_dn[c], truth.mu_dn, 0.15);
  }
}

// Variance of every level against the truth; the row part is not in it.
TEST(CalibrateKinds, NonparametricLevelsHoldTheNoiseOfTheirSignal) {
  const SimulatedCamera camera = polar_mono_camera();
  const NoiseModel model =
      calibrate(simulated_session(camera), small_levels(),
                {ModelKind::kPhysics, ModelKind::kNonparametric}, silent_progress());
  EXPECT_THAT(model.kinds(),
              ::testing::ElementsAre(ModelKind::kPhysics, ModelKind::kNonparametric));
  EXPECT_EQ(contradiction_in(model), "");
  const NonparametricCalibration& n = model.nonparametric.at(0);
  for (std::size_t c = 0; c < 4; ++c) {
    const PhysicsChannel& truth = camera.gains[0].noise.channels[c];
    const NonparametricChannel& channel = n.channels[c];
    ASSERT_GE(channel.level_dn.size(), 12u);
    EXPECT_EQ(channel.level_dn[0], 0.0);
    EXPECT_EQ(n.sigma_row_dn[c], model.physics[0].sigma_row.mean[c]);
    for (std::size_t l = 0; l < channel.level_dn.size(); ++l) {
      if (channel.level_dn[l] > 3800) continue;  // clipped at white
      const LevelMoments found = level_moments(channel, l);
      const double variance = pixel_variance(truth, channel.level_dn[l]);
      const auto samples = static_cast<double>(channel.samples[l]);
      // Borrowing from neighbours and the bins' width cost up to 2 %.
      EXPECT_NEAR(found.variance_dn2, variance, variance * (5 * std::sqrt(2 / samples) + 0.02))
          << c << " " << channel.level_dn[l];
      EXPECT_NEAR(found.mean_dn, truth.mu_dn, 0.15 + 5 * std::sqrt(variance / samples));
    }
  }
}

// A burst of a scene with many signals, its clean version known from a low-gain stack that has
// another exposure.
CalibrationInput burst_with_reference(const PhysicsNoise& noise) {
  CalibrationInput input;
  const auto frame = [noise](double slope, double dark, std::uint32_t index, bool noisy) {
    RawFrame out;
    out.black_dn = {100};
    out.white_dn = 4095;
    out.dn = Image(128, 128);
    for (int r = 0; r < 128; ++r)
      for (int c = 0; c < 128; ++c)
        out.dn(r, c) = static_cast<float>(slope * (r / 8 * 128 / 8 + c / 8));
    if (noisy) add_noise_exact(noise, out.dn, out.dn, DrawAddress{9, index, 0, 0});
    for (float& v : out.dn.values()) v += static_cast<float>(100 + dark);
    return out;
  };
  FrameSet burst, reference;
  burst.kind = FrameKind::kBurst;
  burst.gain.iso = 1600;
  burst.count = 30;
  burst.load = [frame](int i) { return frame(12.0, 0.0, static_cast<std::uint32_t>(i), true); };
  reference.kind = FrameKind::kReference;
  reference.gain.iso = 50;
  reference.count = 2;
  reference.load = [frame](int) { return frame(3.0, 0.0, 0, false); };
  input.sets = {burst, reference};
  return input;
}

// Mean and deviation of the level of signal zero.
void expect_dark_level(const NonparametricCalibration& found, const SimulatedCamera& camera) {
  for (std::size_t c = 0; c < 4; ++c) {
    const PhysicsChannel& truth = camera.gains[0].noise.channels[c];
    const NonparametricChannel& channel = found.channels[c];
    double mean = 0, square = 0;
    for (std::size_t b = 0; b < channel.pmf[0].size(); ++b) {
      const double centre = 0.5 * (channel.bin_edges_dn[b] + channel.bin_edges_dn[b + 1]);
      mean += channel.pmf[0][b] * centre;
      square += channel.pmf[0][b] * centre * centre;
    }
    EXPECT_NEAR(mean, truth.mu_dn, 0.15);
    EXPECT_NEAR(std::sqrt(square - mean * mean),
                std::hypot(std::sqrt(pixel_variance(truth, 0)), camera.dsnu_dn), 0.1);
  }
}

// Dark frames of the flats' exposure, with a dark signal of 12 DN, are not the dark level.
TEST(CalibrateKinds, OnlyBiasFramesMakeTheDarkLevel) {
  const SimulatedCamera camera = polar_mono_camera();
  CalibrationInput input = simulated_session(camera);
  FrameSet darks = input.sets[0];
  darks.exposure_s = 1.0;
  darks.count = 20;
  testing::change_frames(darks, [](RawFrame& frame, int) {
    for (float& v : frame.dn.values()) v += 12;
  });
  input.sets.insert(input.sets.begin() + 1, darks);
  const NoiseModel model = calibrate(
      input, small_levels(), {ModelKind::kPhysics, ModelKind::kNonparametric}, silent_progress());
  expect_dark_level(model.nonparametric.at(0), camera);
}

TEST(CalibrateKinds, FramesWithoutTheirBlackLevelHaveNegativeCodes) {
  const SimulatedCamera camera = polar_mono_camera();
  CalibrationInput input = simulated_session(camera);
  testing::change_frames(input, [](RawFrame& frame, int) {
    for (float& v : frame.dn.values()) v -= 80;
    frame.black_dn.assign(4, 0.0);
    frame.white_dn -= 80;
  });
  const NoiseModel model = calibrate(
      input, small_levels(), {ModelKind::kPhysics, ModelKind::kNonparametric}, silent_progress());
  expect_dark_level(model.nonparametric.at(0), camera);
  EXPECT_THAT(model.physics[0].warnings,
              ::testing::Not(::testing::Contains(::testing::HasSubstr("dark pixels are 0"))));
}

TEST(CalibrateKinds, MissingBrightFramesAreSaid) {
  CalibrationInput input = simulated_session(polar_mono_camera());
  const auto warnings = [&] {
    return calibrate(input, small_levels(), {ModelKind::kPhysics, ModelKind::kNonparametric},
                     silent_progress())
        .nonparametric.at(0)
        .warnings;
  };
  const auto said = ::testing::Contains(::testing::HasSubstr("brighter signals are drawn"));
  EXPECT_THAT(warnings(), ::testing::Not(said));
  input.sets.resize(1 + 6);  // up to 40 % of the range
  EXPECT_THAT(warnings(), said);
}

TEST(CalibrateKinds, LevelsTooFarApartAreSaid) {
  using ::testing::Contains, ::testing::HasSubstr, ::testing::Not;
  SimulatedCamera camera = polar_mono_camera();
  camera.flat_levels = 3;
  const auto warnings = [&] {
    return calibrate(simulated_session(camera), small_levels(), {ModelKind::kNonparametric},
                     silent_progress())
        .nonparametric.at(0)
        .warnings;
  };
  EXPECT_THAT(warnings(), Contains(HasSubstr("no frames between")));
  for (PhysicsChannel& channel : camera.gains[0].noise.channels) channel.gain_dn_per_e = 0.002;
  EXPECT_THAT(warnings(), Not(Contains(HasSubstr("no frames between"))));
}

// (1 - 2/N) / sqrt(1 - 1/N) of the skewness is left by N frames about their own mean.
TEST(CalibrateKinds, SkewnessThatFewFlatsLoseIsSaid) {
  using ::testing::Contains, ::testing::HasSubstr, ::testing::Not;
  const auto said = [](CalibrationInput input, int flats) {
    for (FrameSet& set : input.sets)
      if (set.kind == FrameKind::kFlat) set.count = flats;
    return calibrate(input, small_levels(), {ModelKind::kNonparametric}, silent_progress())
        .nonparametric.at(0)
        .warnings;
  };
  CalibrationInput input = simulated_session(polar_mono_camera());
  EXPECT_THAT(said(input, 2), Contains(HasSubstr("flats of 2 frames: compared with their own "
                                                 "mean, 100 % of the noise's skewness is lost")));
  EXPECT_THAT(said(input, 4), Contains(HasSubstr("flats of 4 frames: compared with their own "
                                                 "mean, 42 % of the noise's skewness is lost")));
  EXPECT_THAT(said(input, 8), Not(Contains(HasSubstr("skewness"))));
  // A burst of a scene holds the levels' shape.
  input.sets.push_back(input.sets[6]);
  input.sets.back().kind = FrameKind::kBurst;
  EXPECT_THAT(said(input, 4), Not(Contains(HasSubstr("skewness"))));
}

// Levels that were left out for few samples are not said to be missing in the frames.
TEST(CalibrateKinds, LevelsWithFewSamplesAreNotMissingFrames) {
  using ::testing::AllOf, ::testing::Contains, ::testing::HasSubstr, ::testing::Not;
  CalibrationInput input = simulated_session(polar_mono_camera());
  for (FrameSet& set : input.sets)
    if (set.kind == FrameKind::kFlat) set.count = 2;
  input.sets[2].count = input.sets[3].count = 20;  // only these have samples enough
  CalibrationSettings settings = small_levels();
  settings.level_samples = 200000;
  const auto warnings = calibrate(input, settings, {ModelKind::kPhysics, ModelKind::kNonparametric},
                                  silent_progress())
                            .nonparametric.at(0)
                            .warnings;
  EXPECT_THAT(warnings, Not(Contains(HasSubstr("no frames"))));
  for (const char* place : {"no levels between 0 and", "no levels above"})
    EXPECT_THAT(warnings, Contains(AllOf(HasSubstr(place), HasSubstr("20000 are needed"),
                                         HasSubstr("ask for fewer samples"))));
}

TEST(CalibrateKinds, BurstsWithAReferenceNeedNoFlats) {
  const PhysicsNoise noise = polar_gain(12, "mono", 1).noise;
  const CalibrationInput input = burst_with_reference(noise);
  const NoiseModel model =
      calibrate(input, small_levels(), {ModelKind::kNonparametric}, silent_progress());
  const NonparametricChannel& channel = model.nonparametric.at(0).channels.at(0);
  ASSERT_GT(channel.level_dn.size(), 30u);
  EXPECT_GT(channel.level_dn.back(), 2900);
  for (std::size_t l = 0; l < channel.level_dn.size(); ++l) {
    const double variance = noise.channels[0].gain_dn_per_e * channel.level_dn[l] +
                            read_variance_dn2(noise.channels[0]);
    EXPECT_NEAR(level_moments(channel, l).variance_dn2, variance,
                variance * (5 * std::sqrt(2.0 / static_cast<double>(channel.samples[l])) + 0.02))
        << channel.level_dn[l];
  }
  EXPECT_NEAR(model.nonparametric[0].sigma_row_dn[0], noise.channels[0].sigma_row_dn, 0.15);
}

// Neither flats nor bias frames: the line comes from the burst's levels.
TEST(CalibrateKinds, GaussianFromBurstsAlone) {
  const PhysicsNoise noise = polar_gain(12, "mono", 1).noise;
  const PhysicsChannel& truth = noise.channels[0];
  const NoiseModel model = calibrate(burst_with_reference(noise), small_levels(),
                                     {ModelKind::kGaussian}, silent_progress());
  EXPECT_THAT(model.kinds(), ::testing::ElementsAre(ModelKind::kGaussian));
  EXPECT_EQ(contradiction_in(model), "");
  const GaussianCalibration& g = model.gaussian.at(0);
  EXPECT_GT(g.levels, 30);
  EXPECT_NEAR(g.slope_dn[0], truth.gain_dn_per_e, 4 * g.slope_stderr_dn[0]);
  const double offset = read_variance_dn2(truth) + truth.sigma_row_dn * truth.sigma_row_dn;
  EXPECT_NEAR(g.offset_dn2[0], offset, 4 * g.offset_stderr_dn2[0]);
  EXPECT_LT(g.slope_stderr_dn[0], 0.02 * truth.gain_dn_per_e);
}

CalibrationInput ramp_burst(const PhysicsNoise& noise, double brightest_dn, int size, int frames,
                            std::uint64_t seed, bool rounded) {
  FrameSet burst;
  burst.kind = FrameKind::kBurst;
  burst.gain.iso = 1600;
  burst.count = frames;
  burst.load = [=](int i) {
    return ramp_frame(noise, brightest_dn, size,
                      DrawAddress{seed, static_cast<std::uint32_t>(i), 0, 0}, rounded);
  };
  CalibrationInput input;
  input.sets = {burst};
  return input;
}

TEST(CalibrateKinds, GaussianFromBurstsAndBiasFramesLacksNoGain) {
  const PhysicsNoise noise = polar_gain(12, "mono", 1).noise;
  CalibrationInput input = ramp_burst(noise, 2600, 64, 10, 5, true);
  input.sets.push_back(ramp_burst(noise, 0, 64, 10, 6, true).sets[0]);
  input.sets[1].kind = FrameKind::kBias;
  const auto told = ::testing::Contains(::testing::HasSubstr("K is not known"));
  const auto model = [&](const std::vector<ModelKind>& kinds) {
    return calibrate(input, {.level_samples = 500}, kinds, silent_progress());
  };
  EXPECT_THAT(model({ModelKind::kGaussian}).gaussian.at(0).warnings, ::testing::Not(told));
  EXPECT_THAT(model({ModelKind::kPhysics, ModelKind::kGaussian}).physics.at(0).warnings, told);
}

// Levels that borrowed each other's samples were once taken for independent: the truth scattered by
// twice the stated error, and the bins' width and the bright pixels of a row got into the offset.
// 100 sessions: the variance of z has a standard deviation of 0.14, its mean one of 0.1.
TEST(CalibrateKinds, GaussianFromBurstsStatesItsError) {
  constexpr int kSessions = 100;
  const PhysicsNoise noise = polar_gain(12, "mono", 1).noise;
  const PhysicsChannel& truth = noise.channels[0];
  for (const int frames : {2, 10}) {
    Moments slope, offset;
    for (std::uint64_t i = 0; i < kSessions; ++i) {
      const CalibrationInput input = ramp_burst(noise, 2600, 64, frames, 50 + i, true);
      const NoiseModel model =
          calibrate(input, {.level_samples = 500}, {ModelKind::kGaussian}, silent_progress());
      const GaussianCalibration& g = model.gaussian.at(0);
      slope.add((g.slope_dn[0] - truth.gain_dn_per_e) / g.slope_stderr_dn[0]);
      offset.add(
          (g.offset_dn2[0] - pixel_variance(truth, 0) - truth.sigma_row_dn * truth.sigma_row_dn) /
          g.offset_stderr_dn2[0]);
    }
    for (const Moments& z : {slope, offset}) {
      EXPECT_NEAR(z.variance(), 1.0, 4 * std::sqrt(2.0 / kSessions)) << frames;
      EXPECT_LT(std::abs(z.mean()), 0.6) << frames;
    }
  }
}

// One convention for every way to measure it: the offset is a recorded frame's variance, with the
// rounding in it where there was rounding. Narrow noise, where 1/12 DN² is a seventh of all.
TEST(CalibrateKinds, TheOffsetHoldsTheRoundingOfTheFramesAndNothingElse) {
  PhysicsNoise noise = polar_gain(12, "mono", 1).noise;
  noise.channels[0] = {
      .gain_dn_per_e = 0.004, .lambda = 0.14, .sigma_tl_dn = 0.5, .sigma_row_dn = 0.05};
  const double offset = read_variance_dn2(noise.channels[0]) + 0.05 * 0.05;
  for (const bool rounded : {false, true}) {
    const CalibrationInput input = ramp_burst(noise, 100, 128, 30, 4, rounded);
    const NoiseModel model =
        calibrate(input, small_levels(), {ModelKind::kGaussian}, silent_progress());
    const GaussianCalibration& g = model.gaussian.at(0);
    EXPECT_NEAR(g.offset_dn2[0], offset + (rounded ? 1.0 / 12 : 0.0), 4 * g.offset_stderr_dn2[0]);
    EXPECT_LT(g.offset_stderr_dn2[0], 0.01);
  }
}

TEST(CalibrateKinds, ABurstOfOneLevelGivesNoLine) {
  CalibrationInput input = burst_with_reference(polar_gain(12, "mono", 1).noise);
  testing::change_frames(input, [](RawFrame& frame, int i) {
    for (float& v : frame.dn.values()) v = 300.0f + static_cast<float>(i % 3);
  });
  EXPECT_THROW(calibrate(input, small_levels(), {ModelKind::kGaussian}, silent_progress()),
               InputError);
}

TEST(CalibrateKinds, TooFewSamplesAreRefusedWithTheNumber) {
  SimulatedCamera camera = polar_mono_camera();
  camera.rows = camera.cols = 64;
  try {
    calibrate(simulated_session(camera), {}, {ModelKind::kNonparametric}, silent_progress());
    FAIL() << "was accepted";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("200000 samples"));
    EXPECT_THAT(error.what(), ::testing::HasSubstr("fewer samples per level"));
  }
}

TEST(CalibrateKinds, DarkFramesAreKeptWholeWithoutBlack) {
  SimulatedCamera camera = polar_mono_camera();
  camera.rows = 67;  // the odd row goes: whole cells only
  camera.flat_levels = 0;
  camera.bias_frames = 6;
  CalibrationSettings settings;
  settings.dark_frames = 4;
  const CalibrationInput input = simulated_session(camera);
  const NoiseModel model = calibrate(input, settings, {ModelKind::kDarkFrames}, silent_progress());
  EXPECT_THAT(model.kinds(), ::testing::ElementsAre(ModelKind::kDarkFrames));
  EXPECT_EQ(contradiction_in(model), "");
  ASSERT_EQ(model.dark_frames.size(), 1u);
  ASSERT_EQ(model.dark_frames[0].frames_dn.size(), 4u);
  const Image& kept = model.dark_frames[0].frames_dn[3];
  EXPECT_EQ(kept.rows(), 66);
  EXPECT_EQ(kept(65, 20), input.sets[0].load(3).dn(65, 20) - 80);
}

}  // namespace
}  // namespace malus
