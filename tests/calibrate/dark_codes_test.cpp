// The dark level code by code, and how much room levels and codes take.
#include "malus/calibrate/internal/dark_codes.h"

#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/internal/flat_checks.h"

#include "../problem_of.h"
#include "simulated_session.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

// A white level of 32 bits once took two doubles for each of its codes: 69 GB.
TEST(DarkCodes, HoldTheCodesThatOccurWhateverWhiteIs) {
  RawFrame first;
  first.dn = Image(2, 3, 130.0F);
  first.white_dn = 4294967295.0;
  const MosaicGeometry geometry(first.layout, 2, 3, 1);
  DarkCodes codes(geometry, first.dn, 2.0);
  codes.add(first.dn);
  first.dn(0, 1) = 118;
  first.dn(1, 2) = 700;
  first.dn(1, 1) = -6;
  codes.add(first.dn);
  std::int64_t first_code = 0;
  const std::vector<double> counts = codes.occurred(0, first_code);
  ASSERT_EQ(counts.size(), 354u);
  EXPECT_EQ(first_code, -3);
  EXPECT_EQ(counts.front(), 1.0);
  EXPECT_EQ(counts.back(), 1.0);
  EXPECT_EQ(counts[3 + 59], 1.0);
  EXPECT_EQ(counts[3 + 65], 9.0);
  EXPECT_EQ(codes.frames(), 2);
}

TEST(DarkCodes, LevelsWithoutRoomAreRefusedWithTheFlag) {
  testing::SimulatedCamera camera;
  camera.bias_frames = 4;
  camera.gains.push_back(testing::polar_gain(12, "mono", 1));
  const auto problem = [&](double level_step) {
    return testing::problem_of([&] {
      calibrate(testing::simulated_session(camera), {.level_step = level_step},
                {ModelKind::kNonparametric}, silent_progress());
    });
  };
  for (const double level_step : {1e-4, 0.04}) {
    EXPECT_THAT(problem(level_step), ::testing::HasSubstr("level_step: "));
    EXPECT_THAT(problem(level_step), ::testing::HasSubstr("raise it to"));
  }
  EXPECT_THAT(problem(1e-4), ::testing::HasSubstr("GB of counts"));
  EXPECT_THAT(problem(0.04), ::testing::HasSubstr("numbers of a channel that a model file holds"));
}

// Noise of less than half a step about the middle of two levels leaves the code between them out.
TEST(DarkCodes, ACodeThatNarrowNoiseLeavesOutIsNotTheConverters) {
  const auto told = [](double dark_sd_dn) {
    PhysicsCalibration out;
    out.temporal_sd_dark_dn = {1, dark_sd_dn};
    warn_of_scaled_codes({}, {.codes = {{"R", 2, 2}, {"B", 2, 2, 65.0}}}, out);
    return out.warnings;
  };
  EXPECT_THAT(told(0.99), ::testing::IsEmpty());
  EXPECT_THAT(told(1.01), ::testing::ElementsAre(
                              ::testing::HasSubstr("B: no dark pixel has the code 65, though")));
}

}  // namespace
}  // namespace malus
