// Flats at a full well below white: no part of what the others show. Refused levels.
#include "malus/calibrate/calibrate.h"
#include "malus/noise/data_sheet.h"

#include <algorithm>
#include <cmath>

#include "simulated_session.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

// One channel, PRNU 2 %; the eighth level of 12 and all brighter ones reach the well of 2000 DN.
CalibrationInput session_of_well(bool brightest_first) {
  testing::SimulatedCamera camera;
  camera.rows = camera.cols = 128;
  camera.bias_frames = 30;
  camera.prnu = 0.02;
  camera.shading = 0.05;
  camera.seed = 5;
  camera.gains.push_back(testing::polar_gain(0, "mono", 1));
  CalibrationInput input = testing::simulated_session(camera);
  testing::change_frames(input, [](RawFrame& frame, int) {
    for (float& v : frame.dn.values()) v = std::min(v, 2080.0F);
  });
  if (brightest_first) std::reverse(input.sets.begin() + 1, input.sets.end());
  return input;
}

// The map was drawn towards 1 by the levels at the well: PRNU came out at next to nothing. 3.5
// standard errors: by chance in 1 of 2000 runs.
TEST(FullWell, LevelsThereAreNoPartOfThePrnu) {
  for (const bool brightest_first : {false, true}) {
    const PhysicsCalibration p =
        calibrate_physics(session_of_well(brightest_first), {}, silent_progress()).physics.at(0);
    ASSERT_TRUE(std::any_of(p.transfer.begin(), p.transfer.end(),
                            [](const PhotonTransferPoint& point) { return point.saturated; }));
    EXPECT_NEAR(p.prnu.at(0), 0.02, 3.5 * p.prnu_stderr.at(0)) << brightest_first;
    EXPECT_LT(p.prnu_stderr.at(0), 3e-4);
  }
}

// The converter ends at 2080 DN, the sensor's dark level is 80 DN: the full well is 2000 DN (less
// the bias, 0.65 DN), whatever black level the frames state.
TEST(FullWell, IsAboveTheDarkLevelWhateverBlackIsDeclared) {
  for (const double black_dn : {0.0, 80.0}) {
    CalibrationInput input = session_of_well(false);
    testing::change_frames(input, [=](RawFrame& frame, int) {
      frame.black_dn = {black_dn};
      frame.white_dn = 2080;
    });
    const NoiseModel model = calibrate_physics(input, {}, silent_progress());
    const PhysicsCalibration& p = model.physics.at(0);
    EXPECT_NEAR(saturation_level_dn(model, p, 0), 2000.65, 0.5) << black_dn;
    for (const PhotonTransferPoint& point : p.transfer)
      EXPECT_EQ(point.at_white, point.mean_dn > 1800) << point.mean_dn << " " << point.why_not;
  }
}

// Their texts were compared without digits: "5.08 %" and "60 %" had been two reasons.
TEST(RefusedLevels, OfOneReasonAreCountedTogether) {
  testing::SimulatedCamera camera = testing::mono_camera(0.4, 0.14, 2.0, 0.5, 0);
  camera.flat_levels = 4;
  CalibrationInput input = testing::simulated_session(camera);
  const double at_white[] = {0.051, 0.6, 0.0, 0.33};
  for (std::size_t i = 1; i < input.sets.size(); ++i)
    testing::change_frames(input.sets[i], [&, i](RawFrame& frame, int) {
      for (float& v : frame.dn.values()) v = std::round(0.1F * v) + (i == 3 ? 3400 : 80);
      const auto pixels = static_cast<int>(at_white[i - 1] * camera.rows * camera.cols);
      for (int k = 0; k < pixels; ++k) frame.dn(k / camera.cols, k % camera.cols) = 4095;
    });
  const auto told = calibrate_physics(input, {}, silent_progress()).physics.at(0).warnings;
  using ::testing::HasSubstr;
  EXPECT_THAT(told, ::testing::Contains(::testing::AllOf(
                        HasSubstr("the gain K is not known: 0 usable"), HasSubstr("3 of 4: 5.08"),
                        HasSubstr("of the pixels are saturated"))));
}

}  // namespace
}  // namespace malus
