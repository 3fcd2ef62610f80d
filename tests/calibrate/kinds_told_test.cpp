#include "malus/calibrate/calibrate.h"

#include <string>
#include <string_view>
#include <vector>

#include "simulated_session.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::polar_mono_camera;
using testing::simulated_session;
using testing::SimulatedCamera;

class HeardWarnings final : public Progress {
 public:
  void begin(std::string_view, std::int64_t) override {}
  void advance(std::int64_t) override {}
  void warn(std::string_view message) override { lines.emplace_back(message); }
  bool stop_requested() const override { return false; }
  std::vector<std::string> lines;
};

TEST(CalibrateKinds, WarningsOfACameraThatTellsNoGainBeginWithWhatIsWrong) {
  SimulatedCamera camera = polar_mono_camera();
  camera.gains[0].gain = {};
  camera.flat_levels = 0;
  camera.bias_frames = 1;
  HeardWarnings heard;
  calibrate(simulated_session(camera), {}, {ModelKind::kDarkFrames}, heard);
  EXPECT_THAT(heard.lines, ::testing::Contains(::testing::StartsWith("only one bias frame")));
  EXPECT_THAT(heard.lines, ::testing::Contains(::testing::HasSubstr("gain_db or iso")).Times(1));
  EXPECT_THAT(heard.lines, ::testing::Each(::testing::Not(::testing::HasSubstr("unknown gain"))));
}

TEST(CalibrateKinds, NoKindsAndMissingFramesAreNamed) {
  SimulatedCamera camera = polar_mono_camera();
  camera.flat_levels = 0;
  camera.bias_frames = 4;
  const CalibrationInput input = simulated_session(camera);
  EXPECT_THROW(calibrate(input, {}, std::vector<ModelKind>(), silent_progress()), InputError);
  EXPECT_THROW(calibrate(input, {}, {ModelKind::kGaussian}, silent_progress()), InputError);
  EXPECT_THROW(calibrate(input, {}, {ModelKind::kNonparametric}, silent_progress()), InputError);
}

}  // namespace
}  // namespace malus
