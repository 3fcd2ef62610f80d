// What calibration says of cameras that change their frames after the conversion, of light that is
// not as told, and of layouts that the flats contradict. bench/session_faults.py has the same and
// more with a camera of its own.
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/internal/bias_checks.h"
#include "malus/calibrate/internal/gain_map.h"
#include "malus/calibrate/internal/response_checks.h"
#include "malus/calibrate/internal/temporal_filter.h"

#include <cmath>
#include <numbers>

#include "simulated_session.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::AllOf;
using testing::change_frames;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using testing::simulated_session;
using testing::SimulatedCamera;

SimulatedCamera faultless_camera(const char* layout = "mono", int size = 128,
                                 std::uint64_t seed = 0) {
  SimulatedCamera camera;
  camera.seed = seed;
  camera.rows = camera.cols = size;
  camera.bias_frames = 20;
  camera.flat_levels = 8;
  camera.flat_frames = 4;
  camera.gains.push_back(testing::polar_gain(12, layout, 1));
  return camera;
}

std::vector<std::string> said_of(const CalibrationInput& input) {
  return calibrate_physics(input, {}, silent_progress()).physics.front().warnings;
}

std::vector<std::string> said_of(const SimulatedCamera& camera,
                                 const testing::FrameChange& change) {
  CalibrationInput input = simulated_session(camera);
  change_frames(input, change);
  return said_of(input);
}

// Every value, black and white included, as `code` writes it.
testing::FrameChange coded_as(double (*code)(double)) {
  return [code](RawFrame& frame, int) {
    for (float& v : frame.dn.values())
      v = static_cast<float>(code(std::max(static_cast<double>(v), 0.0)));
    for (double& black : frame.black_dn) black = code(black);
    frame.white_dn = code(frame.white_dn);
  };
}

void multiply_light(RawFrame& frame, int row, int col, double factor) {
  float& v = frame.dn(row, col);
  const double black = frame.black_at(row, col);
  v = static_cast<float>(std::round(black + (v - black) * factor));
}

TEST(SessionFaults, OrdinaryCamerasAreLeftAlone) {
  for (const char* layout : {"mono", "bayer-rggb", "polar-mono"})
    for (std::uint64_t seed = 0; seed < 4; ++seed)
      EXPECT_THAT(said_of(simulated_session(faultless_camera(layout, 128, seed))), IsEmpty())
          << layout << " " << seed;
}

// Of 12 bits times 4.7 the step was taken for 1 DN, and the read noise held the steps.
TEST(ScaledCodes, AreTold) {
  SimulatedCamera camera = faultless_camera();
  camera.gains = {testing::polar_gain(0, "mono", 1)};
  const auto told = HasSubstr("values were multiplied after the conversion");
  const auto stretched = coded_as([](double v) { return std::floor(4.7 * v); });
  EXPECT_THAT(said_of(camera, stretched), Contains(AllOf(told, HasSubstr("its codes lie 4."))));
  EXPECT_THAT(said_of(camera, coded_as([](double v) { return std::floor(1.5 * v); })),
              Contains(AllOf(told, HasSubstr("its codes lie 1."))));
  // Codes that never occur bend the shape of narrow noise before its variance shows it; and where
  // they lie farther apart than the noise is wide, only the light does.
  camera.gains[0].noise.channels[0].sigma_tl_dn = 1.2;
  const auto fourth_missing = coded_as(
      [](double v) { return std::fmod(std::round(v), 4.0) == 3.0 ? std::round(v) - 1.0 : v; });
  EXPECT_THAT(said_of(camera, fourth_missing),
              Contains(AllOf(told, HasSubstr("the converter leaves codes out"))));
  EXPECT_THAT(said_of(camera, coded_as([](double v) { return std::round(1.07 * v); })),
              Contains(told));
  // A step that all are multiples of is known as it is.
  EXPECT_THAT(said_of(camera, coded_as([](double v) { return 16 * v; })), Not(Contains(told)));
  CalibrationInput dark = simulated_session(camera);
  dark.sets.resize(1);
  change_frames(dark, stretched);
  EXPECT_THAT(said_of(dark), Contains(told));
}

// One code that does not occur among the dark ones, 64 codes from the next: sigma_TL 23 % too
// large, λ 0.34 for 0.14, and not a word.
TEST(LeftOutCode, AmongTheDarkOnesIsTold) {
  SimulatedCamera camera = testing::mono_camera(0.4, 0.14, 1.0, 0.3, 0);
  camera.rows = camera.cols = 128;
  camera.flat_levels = 8;
  const auto told = HasSubstr("no dark pixel has the code 79");
  const auto missing = coded_as(
      [](double v) { return std::fmod(std::round(v), 64.0) == 15.0 ? std::round(v) - 1.0 : v; });
  EXPECT_THAT(said_of(camera, missing), Contains(told));
  EXPECT_THAT(said_of(simulated_session(camera)), Not(Contains(HasSubstr("no dark pixel has"))));
}

// Greens that white balance leaves as they are hid red's steps where the first channel is a green:
// its sigma_TL was 23 % too large, and not a word.
TEST(ScaledCodes, OfAnyChannelAreTold) {
  SimulatedCamera camera = faultless_camera("bayer-grbg");
  camera.gains = {testing::polar_gain(6, "bayer-grbg", 1)};
  const auto balanced = [](RawFrame& frame, int) {
    for (int r = 0; r < 128; ++r)
      for (int c = 0; c < 128; ++c)
        if (frame.layout.channel_at(r, c) == 1) multiply_light(frame, r, c, 1.8);
  };
  EXPECT_THAT(said_of(camera, balanced), Contains(HasSubstr("R: its codes lie 1.8")));
  EXPECT_THAT(said_of(camera, [](RawFrame&, int) {}), Not(Contains(HasSubstr("codes lie"))));
}

// Masked rows had made a PRNU of 800 % and the warning that the light changes.
TEST(UnlitLines, AreTold) {
  const auto masked = [](RawFrame& frame, int) {
    if (frame.dn(64, 64) < 120) return;  // in the dark they are as the others
    for (int r = 0; r < 128; ++r)
      for (int c = 0; c < 128; ++c)
        if (r < 8 || c == 127) frame.dn(r, c) = static_cast<float>(80 + (3 * r + 5 * c) % 4);
  };
  EXPECT_THAT(said_of(faultless_camera(), masked),
              Contains(HasSubstr("8 rows (the first is 0) and 1 column (the first is 127) see no "
                                 "light in the flats")));
}

TEST(DarkLevel, FarAboveTheDeclaredBlackIsTold) {
  const SimulatedCamera camera = faultless_camera();
  const auto told = HasSubstr("is black that of another bit depth? Give black = 12");
  const auto with_black = [&](double black_dn) {
    return said_of(camera, [black_dn](RawFrame& frame, int) {
      for (float& v : frame.dn.values()) v *= 16;
      frame.white_dn = 65520;
      frame.black_dn = {black_dn};
    });
  };
  EXPECT_THAT(with_black(80), Contains(told));  // of 12 bits, for 16
  EXPECT_THAT(with_black(1280), Not(Contains(HasSubstr("black"))));
}

// Read noise of 2.5 e- came out as 5.6 e- with 25 e- of light, and not a word.
TEST(DarkLevel, WhoseShotNoiseIsTheDarkNoiseIsTold) {
  FrameFormat format;
  format.black_dn = {64};
  format.black_known = true;
  const auto told = [&](double mu_dn, double sd_dn) {
    PhysicsCalibration out;
    out.K.mean = {0.4};
    out.mu.mean = {mu_dn};
    out.temporal_sd_dark_dn = {sd_dn};
    warn_of_lit_darkness(format, out);
    return out.warnings;
  };
  const double read2 = 1.1, light_dn = 0.4 * 25;
  EXPECT_THAT(told(light_dn, std::sqrt(read2 + 0.4 * light_dn)),
              Contains(HasSubstr("were the dark frames dark?")));
  EXPECT_THAT(told(light_dn, std::sqrt(read2)), IsEmpty());  // more than light could make
  EXPECT_THAT(told(2.0, std::sqrt(read2)), IsEmpty());
  format.black_known = false;
  EXPECT_THAT(told(light_dn, std::sqrt(read2 + 0.4 * light_dn)), IsEmpty());
}

// K was 7 % too large at 44 standard errors with a shading of 10 % that the camera corrects.
TEST(GainMap, OfAFlatFieldCorrectionIsTold) {
  SimulatedCamera camera = faultless_camera();
  const auto corrected = [&](double share) {
    return said_of(camera, [&, share](RawFrame& frame, int) {
      for (int r = 0; r < camera.rows; ++r)
        for (int c = 0; c < camera.cols; ++c) {
          const double y = 2.0 * r / camera.rows - 1, x = 2.0 * c / camera.cols - 1;
          multiply_light(frame, r, c, 1 / (1 - share * camera.shading * 0.5 * (x * x + y * y)));
        }
    });
  };
  const auto told = Contains(AllOf(HasSubstr("over the frame, the light by"),
                                   HasSubstr("flat-field or shading correction")));
  EXPECT_THAT(corrected(0), IsEmpty());
  EXPECT_THAT(corrected(1), told);
  // That K rests on the flats alone is said of the dark frames, not of the light.
  camera.black_dn = 0;
  EXPECT_THAT(corrected(0), AllOf(Contains(HasSubstr("K rests on the flat frames")), Not(told)));
  EXPECT_THAT(corrected(1), AllOf(Contains(HasSubstr("K rests on the flat frames")), told));
}

// A Gaussian or non-parametric model alone had the wrong gain, too, and none of these words.
TEST(SessionFaults, AreToldWhateverTheKind) {
  SimulatedCamera camera = faultless_camera();
  CalibrationInput input = simulated_session(camera);
  change_frames(input, [&](RawFrame& frame, int) {
    for (int r = 0; r < camera.rows; ++r)
      for (int c = 0; c < camera.cols; ++c) multiply_light(frame, r, c, 1 - 0.2 * c / camera.cols);
  });
  const auto told = Contains(HasSubstr("over the frame, the light by"));
  CalibrationSettings settings;
  settings.level_samples = 1000;
  const auto model_of = [&](const std::vector<ModelKind>& kinds) {
    return calibrate(input, settings, kinds, silent_progress());
  };
  EXPECT_THAT(model_of({ModelKind::kGaussian}).gaussian.at(0).warnings, told);
  EXPECT_THAT(model_of({ModelKind::kNonparametric}).nonparametric.at(0).warnings, told);
  const NoiseModel both = model_of({ModelKind::kPhysics, ModelKind::kGaussian});
  EXPECT_THAT(both.physics.at(0).warnings, told);
  EXPECT_THAT(both.gaussian.at(0).warnings, Not(told));
}

// A bent response makes the gain of dim corners another, too, but more so the brighter the level.
TEST(GainMap, OfABentResponseIsNone) {
  SimulatedCamera camera = faultless_camera();
  camera.shading = 0.6;
  EXPECT_THAT(said_of(camera,
                      [](RawFrame& frame, int) {
                        for (float& v : frame.dn.values())
                          v = std::round(v - 0.05F * (v - 80) * (v - 80) / 4015.0F);
                      }),
              Not(Contains(HasSubstr("over the frame"))));
}

// Four blocks beside each other hold the same 16 draws of rows.
TEST(GainMap, OfStrongRowNoiseIsNone) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    SimulatedCamera camera = testing::mono_camera(0.4, 0.14, 1.0, 10.0, seed);
    camera.rows = 64;
    camera.cols = 512;
    camera.flat_levels = 4;
    EXPECT_THAT(said_of(camera, [](RawFrame&, int) {}), Not(Contains(HasSubstr("over the frame"))))
        << seed;
  }
}

TEST(LightProfile, MainsFlickerUnderARollingShutterIsTold) {
  const SimulatedCamera camera = faultless_camera();
  EXPECT_THAT(said_of(camera,
                      [](RawFrame& frame, int i) {
                        for (int r = 0; r < frame.dn.rows(); ++r)
                          for (int c = 0; c < frame.dn.cols(); ++c)
                            multiply_light(frame, r, c, 1 + 0.02 * std::sin(0.1 * r + 2.5 * i));
                      }),
              Contains(AllOf(HasSubstr("the light changes by 1"), HasSubstr("down the frame"),
                             HasSubstr("rolling shutter"))));
}

// White noise, and a recursive filter y = w x + (1 - w) y of the frame before: its frames correlate
// by 1 - w. Level: of 40 values none beyond 4.5 standard errors.
TEST(SuccessiveFrames, CorrelateAsTheFilterMakesThem) {
  constexpr int kSize = 64, kFrames = 24;
  const MosaicGeometry geometry(SensorLayout::named("polar-mono"), kSize, kSize, 1);
  for (const double weight : {1.0, 0.5})
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      SuccessiveFrames frames(geometry);
      Image state =
          testing::white_noise(kSize, kSize, seed, 1000, 3 * std::sqrt(weight / (2 - weight)));
      for (std::uint32_t f = 0; f < kFrames; ++f) {
        const Image next = testing::white_noise(kSize, kSize, seed, f, 3);
        Image read(kSize, kSize);
        for (int r = 0; r < kSize; ++r)
          for (int c = 0; c < kSize; ++c) {
            state(r, c) += static_cast<float>(weight * (next(r, c) - state(r, c)));
            read(r, c) = state(r, c) + static_cast<float>((r * 31 + f * 17) % 7) + 100;  // rows
          }
        frames.add(read);
      }
      // Pixels beyond four deviations are left out: a little of the correlation goes with them.
      EXPECT_NEAR(frames.correlation(), 1 - weight, 4.5 * frames.standard_error() + 0.002)
          << weight << " " << seed;
      PhysicsCalibration out;
      warn_of_temporal_filter(frames, out);
      EXPECT_EQ(out.warnings.size(), weight < 1 ? 1u : 0u);
    }
}

TEST(Layout, OfColoursOnASensorWithoutIsTold) {
  const auto told = HasSubstr("has the sensor colour filters?");
  for (const char* layout : {"bayer-rggb", "polar-bayer-rggb"}) {
    const SensorLayout declared = SensorLayout::named(layout);
    EXPECT_THAT(said_of(faultless_camera(),
                        [&](RawFrame& frame, int) {
                          frame.layout = declared;
                          frame.black_dn.assign(static_cast<std::size_t>(declared.channels()), 80);
                        }),
                Contains(told));
  }
  EXPECT_THAT(said_of(simulated_session(faultless_camera("bayer-rggb"))), Not(Contains(told)));
}

TEST(Layout, OfAnotherColourOrderIsTold) {
  const auto told = [](const char* layout, std::vector<double> light) {
    PhysicsCalibration out;
    warn_of_colors(SensorLayout::named(layout), {3, light}, out);
    return out.warnings;
  };
  const std::vector<double> rggb = {300, 503, 500, 410};
  EXPECT_THAT(told("bayer-rggb", rggb), IsEmpty());
  EXPECT_THAT(told("bayer-bggr", rggb), IsEmpty());  // nothing tells red from blue
  for (const char* other : {"bayer-gbrg", "bayer-grbg"})
    EXPECT_THAT(told(other, rggb), Contains(HasSubstr("another order of the colours?")));
  // One line for all gains: how red and blue differ is noise, and another digit at each.
  EXPECT_THAT(told("bayer-gbrg", {300, 500, 500.2, 410}), Contains(HasSubstr("the two greens")));
  EXPECT_EQ(told("bayer-gbrg", {300, 500, 500.2, 410}), told("bayer-gbrg", {300, 500, 502, 410}));
}

// Malus's law, channels that respond differently by up to 3 %.
TEST(Layout, OfAnglesAtOtherPlacesIsTold) {
  const auto told = [](const char* declared, const SensorLayout& true_layout, double dolp,
                       double aolp_deg) {
    std::vector<double> light;
    for (int c = 0; c < true_layout.channels(); ++c) {
      const double angle = *true_layout.site(c).angle_deg - aolp_deg;
      light.push_back(1000 * (1 + dolp * std::cos(angle * std::numbers::pi / 90)) *
                      (1 + 0.03 * std::sin(1.7 * c)));
    }
    PhysicsCalibration out;
    warn_of_angles(SensorLayout::named(declared), {3, light}, out);
    return out.warnings;
  };
  const auto other = SensorLayout::from_sites({{"90", "0"}, {"135", "45"}});
  for (const char* layout : {"polar-mono", "polar-bayer-rggb"})
    for (const double dolp : {0.0, 0.2, 0.9})
      for (double aolp = 0; aolp < 180; aolp += 15)
        EXPECT_THAT(told(layout, SensorLayout::named(layout), dolp, aolp), IsEmpty())
            << layout << ' ' << dolp << ' ' << aolp;
  EXPECT_THAT(told("polar-mono", other, 0, 0), IsEmpty());
  // Light at 22.5 degrees shares out evenly among that pairing; elsewhere it tells.
  for (const double aolp : {0.0, 45.0, 60.0, 90.0, 135.0})
    EXPECT_THAT(told("polar-mono", other, 0.3, aolp),
                Contains(HasSubstr("crossed polarizers see the same")))
        << aolp;
}

TEST(Layout, OfAnglesOnASensorOfColoursIsTold) {
  PhysicsCalibration out;
  warn_of_angles(SensorLayout::named("polar-mono"), {3, {300, 503, 500, 410}}, out);
  EXPECT_THAT(out.warnings, Contains(HasSubstr("crossed polarizers see the same")));
}

// The light of the simulated channels falls by 2 % from one to the next: as PRNU it was silent.
TEST(Layout, OfOneChannelOnAMosaicIsTold) {
  const auto declared_mono = [](RawFrame& frame, int) {
    frame.layout = SensorLayout();
    frame.black_dn = {80};
  };
  EXPECT_THAT(
      said_of(faultless_camera("bayer-rggb"), declared_mono),
      Contains(HasSubstr("repeat every 2 rows or columns of a channel: is the layout mono")));
  EXPECT_THAT(said_of(faultless_camera("polar-bayer-rggb"), declared_mono),
              Contains(HasSubstr("repeat every 4 rows or columns")));
}

TEST(ResponsePattern, APictureOfTheSurfaceIsTold) {
  const Image fine = testing::white_noise(130, 130, 9, 0, 1);
  EXPECT_THAT(said_of(faultless_camera(),
                      [&](RawFrame& frame, int) {
                        for (int r = 0; r < 128; ++r)
                          for (int c = 0; c < 128; ++c) {
                            double grain = 0;
                            for (int k = 0; k < 9; ++k) grain += fine(r + k / 3, c + k % 3) / 3;
                            multiply_light(frame, r, c, 1 + 0.01 * grain);
                          }
                      }),
              Contains(HasSubstr("PRNU holds a picture of the lit surface")));
}

}  // namespace
}  // namespace malus
