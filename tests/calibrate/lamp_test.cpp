// Flats of a lamp that flickers, or comes late: what is left of it in K, and what is said.
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/internal/flat_checks.h"
#include "malus/calibrate/internal/lamp_flicker.h"

#include <cmath>
#include <string>
#include <tuple>

#include "simulated_session.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::AllOf;
using testing::change_frames;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::simulated_session;
using testing::SimulatedCamera;

// One channel of K 0.2 DN, 16 bias frames and flats of 4 frames.
SimulatedCamera camera_under_a_lamp(double flicker, double shading, std::uint64_t seed) {
  SimulatedCamera camera = testing::mono_camera(0.2, 0.14, 0.8, 0.2, seed);
  camera.rows = camera.cols = 96;
  camera.bias_frames = 16;
  camera.flat_levels = 8;
  camera.flat_frames = 4;
  camera.flicker = flicker;
  camera.shading = shading;
  return camera;
}

PhysicsCalibration told_of(const CalibrationInput& input) {
  return calibrate_physics(input, {}, silent_progress()).physics.at(0);
}

// Flats of 0.8 ... 4.8 % of the range, which are shifted and not scaled to one mean.
CalibrationInput dim_session(const SimulatedCamera& camera) {
  CalibrationInput input = simulated_session(camera);
  for (std::uint32_t level = 1; level < input.sets.size(); ++level)
    input.sets[level].load = [camera, level](int i) {
      return testing::internal::simulated_frame(camera, camera.gains[0], 24.0 * level,
                                                1000 + 100 * level + static_cast<std::uint32_t>(i));
    };
  return input;
}

// Flicker of 3 % and a light that falls to 30 % in the corners had made K 2.6 % too large and was
// called light that changes down the frame; even light had nothing to split. The mean of six
// sessions is known to 0.16 %: 3.7 of these.
TEST(Lamp, FlickerOfDimUnevenLightIsNoNoise) {
  constexpr int kSessions = 6;
  for (const double shading : {0.7, 0.0}) {
    double gain = 0;
    for (unsigned seed = 1; seed <= kSessions; ++seed) {
      const PhysicsCalibration p = told_of(dim_session(camera_under_a_lamp(0.03, shading, seed)));
      gain += p.K.mean.at(0) / kSessions;
      EXPECT_THAT(p.warnings, Not(Contains(HasSubstr("the light changes"))));
    }
    EXPECT_NEAR(gain / 0.2, 1, 0.006) << shading;
  }
}

// Of light that is even, or constant, or a black level that drifts, nothing is taken off.
TEST(Lamp, FlickerIsToldFromDriftAndNoise) {
  constexpr int kLines = 64, kFrames = 6;
  constexpr double kLightDn = 100, kNoiseDn = 3;
  const MosaicGeometry geometry(SensorLayout::named("mono"), kLines, kLines, 1);
  const Image shading_dn(kLines, kLines);
  const auto found = [&](double flicker, double drift_dn, double fall) {
    LampFlicker lamp(geometry, {80}, shading_dn, {{0, 0}});
    for (std::uint32_t f = 0; f < kFrames; ++f) {
      Image dn = testing::white_noise(kLines, kLines, 9, f, kNoiseDn);
      const double sign = f % 2 == 0 ? 1 : -1;
      for (int r = 0; r < kLines; ++r)
        for (int c = 0; c < kLines; ++c)
          dn(r, c) +=
              static_cast<float>(80 + drift_dn * sign +
                                 kLightDn * (1 + flicker * sign) * (1 + fall * r / (kLines - 1)));
      dn(0, 0) = 4095;  // left out
      lamp.add(dn);
    }
    return lamp.flicker({kNoiseDn * kNoiseDn}, {{0.5}, {}});
  };
  const Flicker lamp = found(0.05, 0, -0.5);
  // Of a line that falls by half, variance 1/12; signs in turn, 6/5. Its pixels' noise: 2 %.
  EXPECT_NEAR(lamp.variance_dn2.at(0), 1.2 * std::pow(0.05 * 50, 2) / 12, 0.06);
  ASSERT_EQ(lamp.relative_light.size(), 6);
  EXPECT_NEAR(lamp.relative_light[0], 1.05, 0.01);
  EXPECT_NEAR(lamp.relative_light[1], 0.95, 0.01);
  for (const auto& [flicker, drift_dn, fall] :
       {std::tuple(0.05, 0.0, 0.0), {0.0, 0.0, -0.5}, {0.0, 5.0, -0.5}, {0.0, 5.0, 0.0}}) {
    const Flicker none = found(flicker, drift_dn, fall);
    EXPECT_EQ(none.variance_dn2.at(0), 0) << flicker << ' ' << drift_dn << ' ' << fall;
    EXPECT_TRUE(none.relative_light.empty());
  }
}

// A code that never changes was scaled as if it were light: 12 of 9216 pixels made K 3 % too large.
// The mean of four sessions is known to 0.17 %.
TEST(Lamp, StuckPixelsDoNotFlicker) {
  constexpr int kSessions = 4;
  double gain = 0;
  for (unsigned seed = 1; seed <= kSessions; ++seed) {
    CalibrationInput input = simulated_session(camera_under_a_lamp(0.03, 0.2, seed));
    change_frames(input, [](RawFrame& frame, int) {
      for (int k = 0; k < 12; ++k) frame.dn(7 * k + 2, 5 * k + 1) = static_cast<float>(300 * k);
    });
    gain += told_of(input).K.mean.at(0) / kSessions;
  }
  EXPECT_NEAR(gain / 0.2, 1, 0.007);
}

// The lamp comes a frame late: brought to the mean of a frame without light, others were noise. Of
// two frames none is the odd one.
TEST(Lamp, AFrameWithoutItsLightIsLeftOut) {
  const auto session = [](int frames, int late) {
    SimulatedCamera camera = camera_under_a_lamp(0.003, 0.2, 5);
    camera.flat_frames = frames;
    CalibrationInput input = simulated_session(camera);
    const FrameSet bias = input.sets[0];
    for (std::size_t i = 1; i < input.sets.size(); ++i)
      input.sets[i].load = [load = input.sets[i].load, bias, late, i](int k) {
        RawFrame frame = k < late ? bias.load(2 * static_cast<int>(i) - 2 + k) : load(k);
        frame.source = "f" + std::to_string(k);
        return frame;
      };
    return told_of(input);
  };
  const auto left_out = Contains(AllOf(HasSubstr("f0 is left out"), HasSubstr("of 7 more levels")));
  const PhysicsCalibration one = session(5, 1);
  EXPECT_NEAR(one.K.mean.at(0), 0.2, 4 * one.K.standard_error.at(0));
  EXPECT_LT(one.K.standard_error.at(0), 0.002);
  EXPECT_THAT(one.warnings, AllOf(left_out, Not(Contains(HasSubstr("its frames run from")))));
  for (const auto& [frames, late] : {std::pair(2, 1), {4, 2}})
    EXPECT_THAT(session(frames, late).warnings,
                AllOf(Not(left_out), Contains(HasSubstr("its frames run from"))));
}

TEST(Lamp, ComesFirstWhereFramesAreOfUnlikeLight) {
  const auto told = [](double brighter_dn) {
    PhysicsCalibration out;
    FlatObservation flat;
    flat.name = "flats of level 2";
    flat.sources = {"a.tif", "b.tif"};
    flat.signal_dn = {brighter_dn, 200};
    const bool any = warn_of_flats({flat}, {.dark_sd_dn = 2, .bias_frames = 2, .step_dn = 1}, out);
    EXPECT_EQ(any, !out.warnings.empty());
    return out.warnings;
  };
  EXPECT_THAT(told(219), ::testing::IsEmpty());
  EXPECT_THAT(told(250),
              ::testing::ElementsAre(
                  "flats of level 2: its frames run from 200 DN of light (b.tif) to 250 DN "
                  "(a.tif): does the lamp flicker? That does no harm; but if these are several "
                  "exposures or light levels, give the frames of each their own [[frames]], with "
                  "`level`"));
}

TEST(Flats, OfOneFrameEachAreNamedAsSuch) {
  CalibrationInput input = simulated_session(camera_under_a_lamp(0.003, 0.2, 5));
  for (std::size_t i = 3; i < input.sets.size(); ++i) input.sets[i].count = 1;
  EXPECT_THAT(told_of(input).warnings,
              AllOf(Contains(AllOf(HasSubstr("PRNU is not known"),
                                   HasSubstr("6 of 6: one frame has no temporal variance"),
                                   Not(HasSubstr("take brighter")))),
                    Contains(AllOf(HasSubstr("K rests on 2 light levels"),
                                   HasSubstr("left out are 6 of 8: one frame")))));
}

// The limit of 70 % was advised where it was in force.
TEST(Flats, ALimitInForceIsNotAdvised) {
  const auto told = [](float well_dn) {
    CalibrationInput input = simulated_session(camera_under_a_lamp(0.003, 0.05, 5));
    change_frames(input, [=](RawFrame& frame, int) {
      for (float& v : frame.dn.values()) v = std::min(v, 80 + well_dn);
    });
    return told_of(input).warnings;
  };
  EXPECT_THAT(told(1800), Contains(AllOf(HasSubstr("the sensor saturates"),
                                         HasSubstr("or a saturation limit of 0.4"))));
  EXPECT_THAT(told(3180), Contains(AllOf(HasSubstr("the sensor saturates"),
                                         HasSubstr("a saturation limit of 0.70, the one in force"),
                                         Not(HasSubstr("use shorter")))));
}

// Of a light that is noise every pairing of angles differs by what it likes.
TEST(Flats, AnglesThatSeeNextToNoLightAreNotJudged) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    SimulatedCamera camera;
    camera.seed = seed;
    camera.bias_frames = 12;
    camera.flat_levels = 4;
    camera.flat_frames = 3;
    camera.gains.push_back(testing::polar_gain(0, "polar-mono", 1));
    CalibrationInput input = simulated_session(camera);
    for (std::uint32_t level = 1; level < input.sets.size(); ++level)
      input.sets[level].load = [camera, level](int i) {
        return testing::internal::simulated_frame(
            camera, camera.gains[0], 0.15, 1000 + 100 * level + static_cast<std::uint32_t>(i));
      };
    EXPECT_THAT(told_of(input).warnings, Not(Contains(HasSubstr("crossed polarizers")))) << seed;
  }
}

}  // namespace
}  // namespace malus
