// Dark current that differs from pixel to pixel, in flats without dark frames of their exposure.
#include "malus/calibrate/calibrate.h"

#include <cmath>

#include "dark_current_sessions.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using testing::add_dark_current;
using ::testing::Contains;
using testing::dark_current_camera;
using testing::dark_current_session;
using ::testing::HasSubstr;
using testing::measured;
using ::testing::Not;
using Current = testing::DarkCurrent;

TEST(DarkCurrent, DarkFramesOfNoFlatsExposureAreTold) {
  CalibrationInput input = dark_current_session(dark_current_camera(0.005), Current{}, 2);
  EXPECT_THAT(measured(input).warnings, Not(Contains(HasSubstr("not used"))));
  FrameSet& last = input.sets.back();
  ASSERT_EQ(last.kind, FrameKind::kBias);
  last.exposure_s = 1.02 * *last.exposure_s;
  const std::string expected = frame_set_name(last) + ": not used";
  EXPECT_THAT(measured(input).warnings, Contains(HasSubstr(expected)));
}

TEST(DarkCurrent, LongFlatsWithoutTheirDarkFramesAreTold) {
  const auto p = measured(dark_current_session(dark_current_camera(0.005), Current{}, 0));
  EXPECT_GT(p.prnu.at(0), 0.01);
  EXPECT_THAT(p.warnings, Contains(HasSubstr("dark current")));
}

// Flats of up to `longest_s`, the light in proportion.
CalibrationInput steady_lamp(double longest_s, const Current& current) {
  CalibrationInput input = testing::simulated_session(dark_current_camera(0.005));
  std::uint32_t address = 1;
  for (FrameSet& set : input.sets) {
    if (set.kind != FrameKind::kFlat) continue;
    const double exposure_s = longest_s * (*set.level + 1) / 8;
    set.exposure_s = exposure_s;
    testing::change_frames(set, [=](RawFrame& frame, int i) {
      add_dark_current(current, exposure_s, 1000 * address + static_cast<std::uint32_t>(i), frame);
    });
    ++address;
  }
  return input;
}

// Below a second, too: where light grows with the exposure, a warm sensor's dark current makes
// PRNU too large and nothing in the session tells of it. Not so of short flats, where dark current
// that did would be none that a sensor has.
TEST(DarkCurrent, FlatsOfLittleLightForTheirExposureAreTold) {
  const auto warm = measured(steady_lamp(0.64, {.mean = 200, .deviation = 60}));
  EXPECT_GT(warm.prnu.at(0), 0.0055);
  EXPECT_THAT(warm.warnings, Contains(HasSubstr("have no dark frames of their exposure")));
  // The more dark current, the more PRNU shows, of which 50 e-/s are next to nothing.
  const auto hot = measured(steady_lamp(0.64, {.mean = 200, .deviation = 250}));
  EXPECT_GT(hot.prnu.at(0), 0.015);
  EXPECT_THAT(hot.warnings, Contains(HasSubstr("have no dark frames of their exposure")));
  const auto brief = measured(steady_lamp(0.05, {.mean = 200, .deviation = 60}));
  EXPECT_NEAR(brief.prnu.at(0), 0.005, 4 * brief.prnu_stderr.at(0));
  EXPECT_THAT(brief.warnings, Not(Contains(HasSubstr("dark current"))));
}

// A lamp that is turned up at `exposure_s`: the more light, the less of it is dark current.
CalibrationInput lamp_turned_up(double exposure_s, const Current& current, std::uint64_t seed,
                                int side = 128) {
  testing::SimulatedCamera camera = dark_current_camera(0.005);
  camera.seed = seed;
  camera.rows = camera.cols = side;
  camera.flat_frames = 8;
  CalibrationInput input = testing::simulated_session(camera);
  std::uint32_t address = 1;
  for (FrameSet& set : input.sets) {
    if (set.kind != FrameKind::kFlat) continue;
    set.exposure_s = exposure_s;
    testing::change_frames(set, [=](RawFrame& frame, int i) {
      add_dark_current(current, exposure_s, 1000 * address + static_cast<std::uint32_t>(i), frame);
    });
    ++address;
  }
  return input;
}

// PRNU was 0.75 % for 0.5; now it lacks what the levels disagree by. Six sessions, four standard
// errors, which say more than nothing.
TEST(DarkCurrent, IsTakenOffWhereLevelsTellOfIt) {
  constexpr int kSessions = 6;
  double off = 0;
  for (std::uint64_t seed = 0; seed < kSessions; ++seed) {
    const auto p = measured(lamp_turned_up(0.9, {.mean = 60, .deviation = 25}, seed));
    EXPECT_THAT(p.warnings, Contains(HasSubstr("PRNU grows with the exposure for the same light")));
    EXPECT_LT(p.prnu_stderr.at(0), 0.0006);
    off += (p.prnu.at(0) - 0.005) / p.prnu_stderr.at(0) / kSessions;
  }
  EXPECT_LT(std::abs(off), 4 / std::sqrt(double{kSessions}));
}

// Bias frames of 2 s, and flats of 2 s or 8 s: the mean bias frame takes 2 s of dark current off
// all of them. It had been counted as if it took none, and 200 ± 60 e-/s made 3.4 % of a PRNU of
// 0.5 % without a word.
TEST(DarkCurrent, OfTheBiasFramesExposureIsTakenOffWithThem) {
  constexpr double kBias_s = 2;
  const Current current{.mean = 60, .deviation = 12};
  testing::SimulatedCamera camera = dark_current_camera(0.005);
  camera.flat_frames = 4;
  const auto measured_with = [&](double long_s) {
    CalibrationInput input = testing::simulated_session(camera);
    std::uint32_t address = 1;
    for (FrameSet& set : input.sets) {
      const double exposure_s = set.level.value_or(0) % 2 ? long_s : kBias_s;
      set.exposure_s = exposure_s;
      testing::change_frames(set, [=, first = 1000 * address++](RawFrame& frame, int i) {
        add_dark_current(current, exposure_s, first + static_cast<std::uint32_t>(i), frame);
      });
    }
    return measured(input);
  };
  const auto of_pixels = Contains(HasSubstr("that differs from pixel to pixel"));
  const auto alike = measured_with(kBias_s);
  EXPECT_NEAR(alike.prnu.at(0), 0.005, 4 * alike.prnu_stderr.at(0));
  EXPECT_LT(alike.prnu_stderr[0], 0.0003);
  EXPECT_THAT(alike.warnings, Not(of_pixels));
  const auto unlike = measured_with(8);
  EXPECT_NEAR(unlike.prnu.at(0), 0.005, 4 * unlike.prnu_stderr.at(0));
  EXPECT_LT(unlike.prnu_stderr[0], 0.001);
  EXPECT_THAT(unlike.warnings, Contains(HasSubstr("PRNU grows with the exposure")));
}

// Levels of a lamp that is turned up tell that there is none, too, if there are enough pixels.
TEST(DarkCurrent, ThatIsAlikeInAllPixelsIsNotTold) {
  CalibrationInput input = lamp_turned_up(0.9, {.mean = 60, .deviation = 0}, 0, 256);
  const auto p = measured(input);
  EXPECT_NEAR(p.prnu.at(0), 0.005, 0.0002);
  EXPECT_THAT(p.warnings, Not(Contains(HasSubstr("dark current"))));
}

}  // namespace
}  // namespace malus
