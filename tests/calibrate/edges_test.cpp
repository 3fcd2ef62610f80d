// Calibration at the edge of what it is given.
#include "malus/calibrate/calibrate.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "dark_current_sessions.h"
#include "problem_of.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using testing::polar_gain;
using testing::simulated_session;
using testing::SimulatedCamera;

// Fractions have no step whose codes could be counted: looking for the one at 0 crashed.
TEST(CalibrationEdges, AnExactZeroAmongFractionsIsNoCode) {
  SimulatedCamera camera = testing::mono_camera(1, 0.14, 2, 0, 5);
  camera.rounded = false;
  camera.bias_frames = 2;
  camera.flat_levels = 0;
  CalibrationInput input = simulated_session(camera);
  testing::change_frames(input, [](RawFrame& frame, int i) {
    if (i == 1) frame.dn(5, 7) = 0;
  });
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  EXPECT_EQ(model.quantization_dn, 0);
  EXPECT_NEAR(model.physics.at(0).temporal_sd_dark_dn.at(0), 2, 0.2);
}

// The layout and the row group repeat together after 88 rows, of which there are 32: row groups
// were read that the frame does not have.
TEST(CalibrationEdges, FewerRowGroupsThanTheLayoutNeedsTellNoDrift) {
  SimulatedCamera camera;
  camera.rows = camera.cols = 32;
  camera.bias_frames = 6;
  camera.flat_levels = 0;
  camera.gains = {polar_gain(12, "mono", 11)};
  PhysicsNoise& noise = camera.gains[0].noise;
  noise.layout = SensorLayout::from_sites(std::vector(8, std::vector<std::string>{"mono"}));
  noise.channels.assign(8, noise.channels.front());
  CalibrationInput input = simulated_session(camera);
  input.row_group = 11;
  const PhysicsCalibration p = calibrate_physics(input, {}, silent_progress()).physics.at(0);
  EXPECT_EQ(p.row_drift.drift.share, 0);
  for (const double error : p.sigma_row.standard_error) EXPECT_GT(error, 0);
}

TEST(CalibrationEdges, SettingsOutsideTheirRangesAreRefused) {
  const CalibrationInput input = simulated_session(testing::small_camera());
  const auto problem = [&](const CalibrationSettings& settings) {
    return testing::problem_of(
        [&] { calibrate(input, settings, {ModelKind::kNonparametric}, silent_progress()); });
  };
  EXPECT_THAT(problem({.saturation_limit = 7}), ::testing::HasSubstr("saturation_limit"));
  EXPECT_THAT(problem({.shape = "likelyhood"}), ::testing::HasSubstr("shape"));
  EXPECT_THAT(problem({.bins = 0}), ::testing::HasSubstr("bins"));
  EXPECT_THAT(testing::problem_of(
                  [&] { calibrate_physics(input, {.saturation_limit = -1}, silent_progress()); }),
              ::testing::HasSubstr("saturation_limit"));
}

// Dark sets are read for every level of their exposure; flats of a gain without bias frames, or
// with one alone, are not read.
TEST(CalibrationEdges, ProgressEndsAtItsTotal) {
  struct Counted final : Progress {
    void begin(std::string_view, std::int64_t steps) override { total += steps; }
    void advance(std::int64_t steps) override { done += steps; }
    void warn(std::string_view) override {}
    bool stop_requested() const override { return false; }
    std::int64_t total = 0, done = 0;
  };
  CalibrationInput input =
      testing::dark_current_session(testing::dark_current_camera(0.005), testing::DarkCurrent{}, 3);
  input.sets.resize(1 + 8 + 1);  // one dark set
  for (FrameSet& set : input.sets)
    if (set.kind == FrameKind::kFlat) set.exposure_s = input.sets.back().exposure_s;
  input.sets[0].count = 6;
  for (const int bias_frames : {6, 1}) {
    input.sets[0].count = bias_frames;
    if (bias_frames == 1) input.sets.back().count = 1;  // no larger set of dark frames
    Counted progress;
    calibrate_physics(input, {}, progress);
    EXPECT_EQ(progress.done, progress.total) << bias_frames;
  }
}

}  // namespace
}  // namespace malus
