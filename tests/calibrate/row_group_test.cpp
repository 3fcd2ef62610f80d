// The row group: how many rows share the offset of one read-out.
#include "malus/calibrate/calibrate.h"

#include <utility>

#include "simulated_session.h"
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::calibrated;
using testing::polar_gain;
using testing::simulated_session;
using testing::SimulatedCamera;
using testing::small_camera;

TEST(CalibrateRowGroup, RowGroupOfOneIsFoundOnMonoBayerAndPolarSensors) {
  for (const char* layout : {"mono", "bayer-rggb", "polar-mono", "polar-bayer-rggb"}) {
    SimulatedCamera camera;
    camera.bias_frames = 40;
    camera.flat_levels = 0;
    camera.gains.push_back(polar_gain(12, layout, 1));
    EXPECT_EQ(calibrated(camera).row_group, 1) << layout;
    camera.gains[0] = polar_gain(12, layout, 2);
    EXPECT_EQ(calibrated(camera).row_group, 2) << layout;
  }
}

TEST(CalibrateRowGroup, WideRowGroupsAreFoundOrNotDecided) {
  SimulatedCamera camera;
  camera.rows = camera.cols = 256;
  camera.bias_frames = 40;
  camera.flat_levels = 0;
  for (const int group : {4, 8}) {
    camera.gains = {polar_gain(12, "mono", group)};
    const NoiseModel model = calibrated(camera);
    EXPECT_EQ(model.row_group, group);
    EXPECT_EQ(model.row_group_origin, "detected");
    EXPECT_FALSE(model.physics[0].row_drift.drift.share > 0) << group;
  }
  camera.gains = {polar_gain(12, "mono", 16)};  // were these told as 8, half of them would be wrong
  EXPECT_EQ(calibrated(camera).row_group_origin, "assumed");
}

// Bias frames of a camera that reads `row_group` rows together.
CalibrationInput tall_session(int row_group) {
  SimulatedCamera camera = testing::mono_camera(0.36, 0.14, 1.2, 0.8, 3);
  camera.rows = 384;
  camera.flat_levels = 0;
  camera.gains[0].noise.row_group = row_group;
  return simulated_session(camera);
}

// Of 3 rows two pairs of three are shared wherever one looks at every second, fourth or eighth:
// that was taken for slow drift, and the groups for single rows.
TEST(CalibrateRowGroup, GroupsOfNoPowerOfTwoAreFoundAndMayBeDeclared) {
  for (const int group : {3, 5, 6, 12}) {
    CalibrationInput input = tall_session(group);
    const NoiseModel model = calibrate_physics(input, {}, silent_progress());
    EXPECT_EQ(model.row_group, group);
    EXPECT_EQ(model.row_group_origin, "detected") << group;
    input.row_group = group;
    EXPECT_THAT(calibrate_physics(input, {}, silent_progress()).physics[0].warnings,
                ::testing::Not(::testing::Contains(::testing::HasSubstr("declares"))))
        << group;
    input.row_group = group / 2;
    EXPECT_THAT(calibrate_physics(input, {}, silent_progress()).physics[0].warnings,
                ::testing::Contains(::testing::HasSubstr("declares")))
        << group;
  }
}

// The same frames without their first rows: the first group ends early.
CalibrationInput cropped_session(int row_group, int rows) {
  CalibrationInput input = tall_session(row_group);
  testing::change_frames(input, [rows](RawFrame& frame, int) {
    Image cropped(frame.dn.rows() - rows, frame.dn.cols());
    for (int r = 0; r < cropped.rows(); ++r)
      for (int c = 0; c < cropped.cols(); ++c) cropped(r, c) = frame.dn(r + rows, c);
    frame.dn = std::move(cropped);
  });
  return input;
}

TEST(CalibrateRowGroup, GroupsThatStartOnAnotherRowAreTold) {
  for (const auto& [group, rows] : {std::pair(3, 1), {4, 2}}) {
    const NoiseModel model = calibrate_physics(cropped_session(group, rows), {}, silent_progress());
    EXPECT_EQ(model.row_group_origin, "assumed") << group;
    EXPECT_THAT(model.physics[0].warnings, ::testing::Contains(::testing::HasSubstr(fmt::format(
                                               "crop the frames by {} row", group - rows))))
        << group;
  }
}

// A declaration wins, and it counts from row 0: without a word σ_b was 22 to 30 % too small and
// σ_TL up to 17 % too large.
TEST(CalibrateRowGroup, DeclaredGroupsThatStartOnAnotherRowAreTold) {
  const auto warnings = [](CalibrationInput input, int declared) {
    input.row_group = declared;
    return calibrate_physics(input, {}, silent_progress()).physics[0].warnings;
  };
  for (const auto& [group, rows] : {std::pair(2, 1), {4, 3}, {16, 5}}) {
    EXPECT_THAT(warnings(cropped_session(group, rows), group),
                ::testing::Contains(::testing::AllOf(
                    ::testing::HasSubstr(fmt::format("declares a row group of {}", group)),
                    ::testing::HasSubstr(fmt::format("crop the frames by {} row", group - rows)))))
        << group << " " << rows;
    EXPECT_THAT(warnings(tall_session(group), group),
                ::testing::Not(::testing::Contains(::testing::HasSubstr("declares"))))
        << group;
  }
  EXPECT_THAT(warnings(cropped_session(2, 1), 1),
              ::testing::Contains(::testing::HasSubstr("declares a row group of 1")));
}

// Slow drift makes all pairs alike, and only a little less than those of one group: it had been
// taken for an undecided group, for which no drift is fitted (σ_b 10 % too small, 2.7 of its
// errors).
TEST(CalibrateRowGroup, RowsThatDriftSlowlyAreNoGroup) {
  SimulatedCamera camera = testing::mono_camera(0.36, 0.14, 1.2, 3.0, 1);
  camera.rows = 256;
  camera.cols = 128;
  camera.flat_levels = 0;
  camera.gains[0].noise.row_drift = {0.9, 30.0};
  for (const int seed : {1, 2, 3, 4, 5}) {
    camera.seed = static_cast<std::uint64_t>(seed);
    const NoiseModel model = calibrated(camera);
    EXPECT_EQ(model.row_group, 1);
    EXPECT_EQ(model.row_group_origin, "detected") << seed;
    const PhysicsCalibration& p = model.physics[0];
    EXPECT_NEAR(p.row_drift.drift.share, 0.9, 4 * p.row_drift.share_stderr) << seed;
    EXPECT_NEAR(p.sigma_row.mean[0], 3.0, 2.5 * p.sigma_row.standard_error[0]) << seed;
  }
}

// Of groups whose rows drift as slowly the pairs inside share all, those across the ends less.
TEST(CalibrateRowGroup, GroupsThatDriftSlowlyAreNoSingleRows) {
  SimulatedCamera camera = testing::mono_camera(0.36, 0.14, 1.2, 3.0, 1);
  camera.rows = 256;
  camera.gains[0].noise.row_group = 2;
  camera.flat_levels = 0;
  camera.gains[0].noise.row_drift = {0.9, 30.0};
  const NoiseModel model = calibrated(camera);
  EXPECT_TRUE(model.row_group == 2 || model.row_group_origin == "assumed");
}

// Rows of a twentieth of a pixel's noise are too weak for two short frames to tell the group; where
// there are none at all nothing is missing.
TEST(CalibrateRowGroup, TheGroupOfWeakRowNoiseIsUndecidedAndThatIsSaid) {
  SimulatedCamera camera = small_camera();
  camera.bias_frames = 2;
  camera.flat_levels = 0;
  for (auto& channel : camera.gains[0].noise.channels)
    channel.sigma_row_dn = 0.05 * std::sqrt(read_variance_dn2(channel));
  const NoiseModel model = calibrated(camera);
  EXPECT_EQ(model.row_group_origin, "assumed");
  EXPECT_THAT(model.physics[0].warnings,
              ::testing::Contains(::testing::HasSubstr("row noise is too weak")));
}

TEST(CalibrateRowGroup, WithoutRowNoiseNoGroupIsMissed) {
  SimulatedCamera camera = small_camera();
  camera.bias_frames = 20;
  camera.flat_levels = 0;
  for (auto& channel : camera.gains[0].noise.channels) channel.sigma_row_dn = 0;
  const NoiseModel model = calibrated(camera);
  EXPECT_EQ(model.row_group_origin, "assumed");
  EXPECT_THAT(model.physics[0].warnings,
              ::testing::Not(::testing::Contains(::testing::HasSubstr("row group not decided"))));
  // Two standard errors reach zero, but for one channel in 40 by chance.
  const ChannelStatistics& row = model.physics[0].sigma_row;
  int away_from_zero = 0;
  for (std::size_t c = 0; c < 16; ++c)
    away_from_zero += row.mean[c] > 2.0001 * row.standard_error[c];
  EXPECT_LE(away_from_zero, 2);
}

TEST(CalibrateRowGroup, ADeclaredRowGroupWinsButIsQuestioned) {
  CalibrationInput input = simulated_session(small_camera());
  input.row_group = 1;
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  EXPECT_EQ(model.row_group, 1);
  EXPECT_EQ(model.row_group_origin, "declared");
  EXPECT_THAT(model.physics[0].warnings,
              ::testing::Contains(::testing::HasSubstr("declares a row group of 1")));
}

}  // namespace
}  // namespace malus
