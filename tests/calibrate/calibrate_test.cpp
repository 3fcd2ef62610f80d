#include "malus/calibrate/calibrate.h"

#include "malus/base/parallel.h"

#include <atomic>
#include <cmath>
#include <limits>
#include <numeric>

#include "simulated_session.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::calibrated;
using testing::polar_gain;
using testing::simulated_session;
using testing::SimulatedCamera;
using testing::small_camera;

// All parameters of all 16 channels within four standard errors (80 values: chance 0.5 %), and
// within sane distances in absolute terms.
TEST(CalibratePhysics, RecoversEveryChannelOfAColourPolarizationSensor) {
  const SimulatedCamera camera = small_camera(11);
  const NoiseModel model = calibrated(camera);
  ASSERT_EQ(model.physics.size(), 1u);
  const PhysicsCalibration& p = model.physics[0];
  EXPECT_EQ(model.row_group, 2);
  EXPECT_EQ(model.row_group_origin, "detected");
  EXPECT_EQ(model.quantization_dn, 1.0);
  EXPECT_EQ(p.bias_frames, 100);
  EXPECT_EQ(p.flat_levels, 12);
  for (std::size_t c = 0; c < 16; ++c) {
    const PhysicsChannel& truth = camera.gains[0].noise.channels[c];
    const auto check = [&](const ChannelStatistics& found, double value, double limit) {
      EXPECT_NEAR(found.mean[c], value, 4 * found.standard_error[c]) << c;
      EXPECT_LT(found.standard_error[c], limit) << c;
    };
    check(p.K, truth.gain_dn_per_e, 0.05 * truth.gain_dn_per_e);
    check(p.mu, truth.mu_dn, 0.1);
    check(p.sigma_row, truth.sigma_row_dn, 0.1 * truth.sigma_row_dn);
    check(p.sigma_tl, truth.sigma_tl_dn, 0.03 * truth.sigma_tl_dn);
    check(p.lambda, truth.lambda, 0.02);
  }
}

TEST(CalibratePhysics, FrameToFrameSpreadIsSeparatedFromSamplingError) {
  SimulatedCamera camera;
  camera.rows = camera.cols = 128;
  camera.bias_frames = 200;
  camera.flat_levels = 0;
  camera.gains.push_back(polar_gain(12));
  auto& gain = camera.gains[0];
  for (const auto& channel : gain.noise.channels) {
    gain.mu_spread_dn.push_back(0.3);
    gain.sigma_row_spread_dn.push_back(0.2 * channel.sigma_row_dn);
    gain.sigma_tl_spread_dn.push_back(0.05 * channel.sigma_tl_dn);
  }
  const auto mean = [](const std::vector<double>& v) {
    return std::accumulate(v.begin(), v.end(), 0.0) / static_cast<double>(v.size());
  };
  const PhysicsCalibration varied = calibrated(camera).physics[0];
  // 200 frames tell a spread to 5 %, less of σ_row, whose own error is 12 % per frame: the means
  // over 16 channels err by 0.004 DN and 0.007, that of σ_TL by 0.001, of which 0.01 is plenty.
  EXPECT_NEAR(mean(varied.mu.spread), 0.3, 0.02);
  EXPECT_NEAR(mean(varied.sigma_row.spread) / mean(varied.sigma_row.mean), 0.2, 0.04);
  EXPECT_NEAR(mean(varied.sigma_tl.spread) / mean(varied.sigma_tl.mean), 0.05, 0.01);
  gain.mu_spread_dn.clear();
  gain.sigma_row_spread_dn.clear();
  gain.sigma_tl_spread_dn.clear();
  const PhysicsCalibration steady = calibrated(camera).physics[0];
  EXPECT_LT(mean(steady.mu.spread), 0.06);
  EXPECT_LT(mean(steady.sigma_row.spread) / mean(steady.sigma_row.mean), 0.08);
  EXPECT_LT(mean(steady.sigma_tl.spread) / mean(steady.sigma_tl.mean), 0.02);
}

// Frames are scaled to one mean, and what that does to their noise is undone: K of a lamp that
// flickers by 15 % was 1.8 % too large. The mean of ten sessions is known to 0.11 % (level: 1e-5).
TEST(CalibratePhysics, AFlickeringLampDoesNotRaiseTheGain) {
  constexpr int kSessions = 10;
  SimulatedCamera camera;
  camera.rows = camera.cols = 96;
  camera.bias_frames = 8;
  camera.flat_levels = 8;
  camera.flat_frames = 4;
  camera.flicker = 0.15;
  camera.gains.push_back(polar_gain(0, "mono", 1));
  double gain = 0;
  for (unsigned seed = 1; seed <= kSessions; ++seed) {
    camera.seed = seed;
    gain += calibrated(camera).physics.at(0).K.mean.at(0) / kSessions;
  }
  const double truth = camera.gains[0].noise.channels[0].gain_dn_per_e;
  EXPECT_NEAR(gain / truth, 1, 0.005);
}

// Drifting rows: the row group is still told, σ_b is all of the rows' deviation, and what the drift
// does to the frames' means is not taken for a bias that varies.
TEST(CalibratePhysics, SlowDriftOfTheRowsIsMeasuredApart) {
  for (const auto& [layout, row_group] : {std::pair("polar-bayer-rggb", 2), {"mono", 1}}) {
    SimulatedCamera camera;
    camera.rows = 256;
    camera.cols = row_group > 1 ? 64 : 128;
    camera.flat_levels = 0;
    camera.seed = 5;
    camera.gains.push_back(polar_gain(18, layout, row_group));
    camera.gains[0].noise.row_drift = {0.8, 4.0};
    const NoiseModel model = calibrated(camera);
    EXPECT_EQ(model.row_group, row_group);
    EXPECT_EQ(model.row_group_origin, "detected");
    const PhysicsCalibration& p = model.physics[0];
    EXPECT_NEAR(p.row_drift.drift.share, 0.8, 4 * p.row_drift.share_stderr) << layout;
    EXPECT_NEAR(p.row_drift.drift.length_groups, 4.0, 4 * p.row_drift.length_stderr) << layout;
    EXPECT_LT(p.row_drift.share_stderr, 0.05);
    for (std::size_t c = 0; c < camera.gains[0].noise.channels.size(); ++c) {
      const double sigma = camera.gains[0].noise.channels[c].sigma_row_dn;
      EXPECT_NEAR(p.sigma_row.mean[c], sigma, 4 * p.sigma_row.standard_error[c]) << layout << c;
      // 100 frames see spreads down to half of one frame's sampling error. White rows' sampling
      // alone would leave 0.15 σ_b of μ and 0.06 σ_b of σ_b on the sensor of one channel.
      if (row_group > 1) continue;
      EXPECT_LT(p.mu.spread[c], 0.11 * sigma);
      EXPECT_LT(p.sigma_row.spread[c], 0.05 * sigma);
    }
  }
}

TEST(CalibratePhysics, SingleFramesShowNoDrift) {
  SimulatedCamera camera = small_camera(3);
  camera.flat_levels = 0;
  camera.rows = 128;
  camera.gains[0].noise.row_drift = {0.8, 4.0};
  EXPECT_FALSE(calibrated(camera).physics[0].row_drift.drift.white());
  EXPECT_TRUE(calibrated(camera, {.single_frame = true}).physics[0].row_drift.drift.white());
}

// The cells of the low gain were as wide as the noise of the high one asks for.
TEST(CalibratePhysics, SingleFramesOfAGainAreNotMeasuredByAnothers) {
  for (const bool one : {true, false}) {
    SimulatedCamera camera;
    camera.rows = camera.cols = 64;
    camera.bias_frames = one ? 1 : 3;
    camera.flat_levels = 0;
    camera.rounded = false;  // else cells are as wide as the step
    camera.gains = {testing::polar_gain(0, "polar-mono", 1),
                    testing::polar_gain(30, "polar-mono", 1)};
    const CalibrationInput both = simulated_session(camera);
    CalibrationInput low = both;
    std::erase_if(low.sets, [](const FrameSet& set) { return set.gain.gain_db != 0.0; });
    const CalibrationSettings settings{.single_frame = !one};
    const PhysicsCalibration alone =
        calibrate_physics(low, settings, silent_progress()).physics.front();
    const PhysicsCalibration beside =
        calibrate_physics(both, settings, silent_progress()).physics.front();
    EXPECT_EQ(beside.gain.gain_db, 0.0);
    EXPECT_EQ(beside.residual_cell_dn, alone.residual_cell_dn);
    EXPECT_EQ(beside.lambda.mean, alone.lambda.mean);
    EXPECT_EQ(beside.sigma_tl.mean, alone.sigma_tl.mean);
  }
}

TEST(CalibratePhysics, FixedPatternIsMeasured) {
  SimulatedCamera camera = small_camera();
  camera.rows = camera.cols = 256;
  camera.dsnu_dn = 1.5;
  camera.prnu = 0.02;
  camera.bias_frames = 20;
  camera.flat_frames = 8;
  const PhysicsCalibration p = calibrated(camera).physics[0];
  for (std::size_t c = 0; c < 16; ++c) {
    EXPECT_NEAR(p.dsnu_dn[c], 1.5, 0.08);
    EXPECT_NEAR(p.prnu[c], 0.02, 0.0015);
    EXPECT_NEAR(p.sigma_tl.mean[c], camera.gains[0].noise.channels[c].sigma_tl_dn,
                4 * p.sigma_tl.standard_error[c]);
  }
  ASSERT_EQ(p.dark_shading_dn.rows(), 256);
  EXPECT_NEAR(p.dark_shading_dn(10, 20), 1.5 * testing::internal::normal_at(0, 10ull << 32 | 20, 2),
              5 * 2.9 / std::sqrt(20.0));
}

TEST(CalibratePhysics, DefectPixelsAreListed) {
  CalibrationInput input = simulated_session(small_camera());
  for (FrameSet& set : input.sets)
    testing::change_frames(set, [kind = set.kind](RawFrame& frame, int i) {
      frame.dn(5, 6) = 300;                                                      // hot and stuck
      if (kind == FrameKind::kBias) frame.dn(20, 31) += i % 2 ? 40.0F : -40.0F;  // noisy
      if (kind == FrameKind::kBias) frame.dn(40, 41) += 60;                      // hot
      if (kind == FrameKind::kFlat) frame.dn(50, 51) = 85;                       // dead
    });
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  std::vector<std::string> found;
  for (const DefectPixel& d : model.defects)
    found.push_back(d.kind + " " + std::to_string(d.row) + "," + std::to_string(d.col));
  EXPECT_THAT(found, ::testing::UnorderedElementsAre("stuck 5,6", "noisy 20,31", "hot 40,41",
                                                     "dead 50,51"));
}

TEST(CalibratePhysics, SameNumbersForAnyThreadCount) {
  SimulatedCamera camera = small_camera();
  camera.bias_frames = 12;
  camera.flat_levels = 3;
  set_thread_count(1);
  const NoiseModel one = calibrated(camera);
  set_thread_count(4);
  const NoiseModel four = calibrated(camera);
  set_thread_count(0);
  EXPECT_EQ(one.physics[0].K.mean, four.physics[0].K.mean);
  EXPECT_EQ(one.physics[0].lambda.mean, four.physics[0].lambda.mean);
  EXPECT_EQ(one.physics[0].sigma_row.standard_error, four.physics[0].sigma_row.standard_error);
}

TEST(CalibratePhysics, LevelsLeftOutCarryTheReasonWithNumbers) {
  SimulatedCamera camera = small_camera();
  const PhysicsCalibration p = calibrated(camera).physics[0];
  int refused = 0;
  for (const PhotonTransferPoint& point : p.transfer) {
    const double share = point.mean_dn / (camera.white_dn - camera.black_dn);
    EXPECT_EQ(point.used, share <= 0.7);
    if (point.used) continue;
    ++refused;
    EXPECT_THAT(point.why_not, ::testing::HasSubstr("above the limit of 70 %"));
  }
  EXPECT_GT(refused, 0);
}

TEST(CalibratePhysics, WarnsOfDriftLightLeaksAndACutBlackLevel) {
  SimulatedCamera camera = small_camera();
  camera.flat_levels = 0;
  camera.bias_frames = 30;
  CalibrationInput input = simulated_session(camera);
  testing::change_frames(input.sets[0], [](RawFrame& frame, int i) {
    for (int r = 0; r < frame.dn.rows(); ++r)
      for (int c = 0; c < frame.dn.cols(); ++c)
        frame.dn(r, c) = std::max(
            0.0F, frame.dn(r, c) - 78 +
                      std::round(0.1F * static_cast<float>(i) + 0.15F * static_cast<float>(r)));
  });
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  const auto& warnings = model.physics[0].warnings;
  EXPECT_THAT(warnings, ::testing::Contains(::testing::HasSubstr("drifts by")));
  EXPECT_THAT(warnings, ::testing::Contains(::testing::HasSubstr("light leak")));
  EXPECT_THAT(warnings, ::testing::Contains(::testing::HasSubstr("of the dark pixels are 0")));
  EXPECT_THAT(warnings, ::testing::Contains(::testing::HasSubstr("no flat frames")));
}

TEST(CalibratePhysics, WarnsOfLitBiasFrames) {
  SimulatedCamera camera = small_camera();
  camera.flat_levels = 0;
  camera.bias_frames = 20;
  const auto warnings = [&](auto light_dn) {
    CalibrationInput input = simulated_session(camera);
    testing::change_frames(input.sets[0], [light_dn](RawFrame& frame, int i) {
      for (float& v : frame.dn.values()) v += light_dn(i);
    });
    return calibrate_physics(input, {}, silent_progress()).physics[0].warnings;
  };
  using ::testing::Contains, ::testing::HasSubstr, ::testing::Not;
  const auto none = warnings([](int) { return 0.0F; });
  EXPECT_THAT(none, Not(Contains(HasSubstr("another setting"))));
  EXPECT_THAT(none, Not(Contains(HasSubstr("are these dark frames"))));
  EXPECT_THAT(warnings([](int i) { return i == 7 ? 10.0F : 0.0F; }),
              Contains(HasSubstr("bias frame 8 of 20: the level lies up to +9.")));
  EXPECT_THAT(warnings([](int) { return 600.0F; }), Contains(HasSubstr("are these dark frames")));
}

// A camera that makes its highest gain by multiplying: wider steps there, and only there.
TEST(CalibratePhysics, EveryGainHasItsOwnConverterStep) {
  SimulatedCamera camera = small_camera();
  camera.flat_levels = 0;
  camera.gains = {polar_gain(0), polar_gain(18)};
  CalibrationInput input = simulated_session(camera);
  testing::change_frames(input.sets[1], [](RawFrame& frame, int) {
    for (float& v : frame.dn.values()) v = 4 * std::round(v / 4);
  });
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  EXPECT_EQ(model.quantization_dn, 1.0);
  for (const std::size_t gain : {0u, 1u})
    for (std::size_t c = 0; c < 16; ++c)
      EXPECT_NEAR(model.physics[gain].sigma_tl.mean[c],
                  camera.gains[gain].noise.channels[c].sigma_tl_dn,
                  4 * model.physics[gain].sigma_tl.standard_error[c]);
  EXPECT_THAT(model.physics[1].warnings,
              ::testing::Contains(::testing::HasSubstr("its codes are multiples of 4 DN")));
}

TEST(CalibratePhysics, FloatFramesHaveNoQuantisation) {
  SimulatedCamera camera = small_camera(5);
  camera.rounded = false;
  const NoiseModel model = calibrated(camera);
  EXPECT_EQ(model.quantization_dn, 0.0);
  for (std::size_t c = 0; c < 16; ++c)
    EXPECT_NEAR(model.physics[0].sigma_tl.mean[c], camera.gains[0].noise.channels[c].sigma_tl_dn,
                4 * model.physics[0].sigma_tl.standard_error[c]);
}

TEST(CalibratePhysics, GuessedBlackAndWhiteAreSaid) {
  struct Warnings final : Progress {
    void begin(std::string_view, std::int64_t) override {}
    void advance(std::int64_t) override {}
    void warn(std::string_view message) override { lines.emplace_back(message); }
    bool stop_requested() const override { return false; }
    std::vector<std::string> lines;
  } progress;
  SimulatedCamera camera = small_camera();
  camera.bias_frames = 4;
  camera.flat_levels = 3;
  camera.levels_known = false;
  calibrate_physics(simulated_session(camera), {}, progress);
  EXPECT_THAT(progress.lines,
              ::testing::Contains(::testing::HasSubstr("black level is not given")));
  EXPECT_THAT(progress.lines,
              ::testing::Contains(::testing::HasSubstr("white level is not given")));
}

TEST(CalibratePhysics, AStopIsHeeded) {
  struct Stop final : Progress {
    void begin(std::string_view, std::int64_t) override {}
    void advance(std::int64_t steps) override { done += static_cast<int>(steps); }
    void warn(std::string_view) override {}
    bool stop_requested() const override { return done >= 5; }
    std::atomic<int> done = 0;
  } progress;
  EXPECT_THROW(calibrate_physics(simulated_session(small_camera()), {}, progress), Cancelled);
  EXPECT_EQ(progress.done, 5);
}

// Sessions at the edge give a model that can be saved, with warnings, or the one line: never a
// model that contradicts itself, never NaN where a number is promised.
TEST(CalibratePhysics, PoorSessionsGiveAConsistentModel) {
  const auto consistent = [](const CalibrationInput& input) {
    const NoiseModel model = calibrate(input, {}, {ModelKind::kPhysics}, silent_progress());
    EXPECT_EQ(contradiction_in(model), "");
    EXPECT_FALSE(model.physics[0].warnings.empty());
    for (const double sigma : model.physics[0].sigma_tl.mean) EXPECT_GE(sigma, 0.0);
    for (const double sd : model.physics[0].temporal_sd_dark_dn) EXPECT_GE(sd, 0.0);
  };
  SimulatedCamera camera = small_camera();
  camera.flat_levels = 2;
  camera.bias_frames = 1;
  consistent(simulated_session(camera));
  camera.bias_frames = 2;
  camera.flat_frames = 1;
  consistent(simulated_session(camera));
  camera.rows = camera.cols = 16;
  consistent(simulated_session(camera));
  CalibrationInput constant = simulated_session(camera);
  testing::change_frames(constant, [](RawFrame& frame, int) {
    std::fill(frame.dn.values().begin(), frame.dn.values().end(), 80.0F);
  });
  consistent(constant);
}

TEST(CalibratePhysics, BadInputIsNamed) {
  SimulatedCamera tiny = small_camera();
  tiny.rows = 12;
  EXPECT_THROW(calibrated(tiny), InputError);
  CalibrationInput flats = simulated_session(small_camera());
  flats.sets.erase(flats.sets.begin());
  EXPECT_THROW(calibrate_physics(flats, {}, silent_progress()), InputError);
  CalibrationInput sizes = simulated_session(small_camera());
  testing::change_frames(sizes.sets[3], [](RawFrame& frame, int) { frame.dn = Image(32, 64); });
  EXPECT_THROW(calibrate_physics(sizes, {}, silent_progress()), InputError);
  CalibrationInput one_group = simulated_session(small_camera());
  one_group.row_group = 64;
  EXPECT_THROW(calibrate_physics(one_group, {}, silent_progress()), InputError);
  CalibrationInput nan = simulated_session(small_camera());
  testing::change_frames(nan.sets[0], [](RawFrame& frame, int i) {
    if (i == 7) frame.dn(3, 3) = std::nanf("");
  });
  EXPECT_THROW(calibrate_physics(nan, {}, silent_progress()), InputError);
}

// The first one named had been the bias set, whatever its exposure.
TEST(CalibratePhysics, OfEqualDarkSetsTheShortestExposureIsTheBiasSet) {
  CalibrationInput input;
  for (const double exposure_s : {5.0, 0.1, 1.0}) {
    FrameSet set;
    set.kind = FrameKind::kBias;
    set.count = 2;
    set.exposure_s = exposure_s;
    input.sets.push_back(set);
  }
  EXPECT_EQ(bias_set_at(GainSetting{}, input), &input.sets[1]);
  input.sets[2].exposure_s.reset();  // no flat's
  EXPECT_EQ(bias_set_at(GainSetting{}, input), &input.sets[2]);
  input.sets[0].count = 3;
  EXPECT_EQ(bias_set_at(GainSetting{}, input), &input.sets[0]);
}

}  // namespace
}  // namespace malus
