// What calibration says of sessions whose frames are not what the session says.
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/internal/across_frames.h"
#include "malus/calibrate/internal/bias_checks.h"
#include "malus/calibrate/internal/flat_checks.h"

#include <cmath>

#include "problem_of.h"
#include "simulated_session.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::AllOf;
using testing::change_frames;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::polar_gain;
using testing::problem_of;
using testing::simulated_session;
using testing::SimulatedCamera;

SimulatedCamera mono_camera(std::uint64_t seed = 0) {
  SimulatedCamera camera;
  camera.seed = seed;
  camera.bias_frames = 20;
  camera.gains.push_back(polar_gain(12, "mono", 1));
  return camera;
}

std::vector<std::string> warnings_of(const CalibrationInput& input) {
  return calibrate_physics(input, {}, silent_progress()).physics.front().warnings;
}

// The same pixels as a camera with a black level that is 20 DN lower would have written them.
void lower_black(RawFrame& frame) {
  for (float& v : frame.dn.values()) v -= 20;
  for (double& black : frame.black_dn) black -= 20;
}

// Above their own black the frames are the same: so is what is found.
TEST(BlackOfTheFiles, MayDifferBetweenGains) {
  SimulatedCamera camera = mono_camera();
  camera.gains = {polar_gain(0, "mono", 1), polar_gain(24, "mono", 1)};
  const CalibrationInput input = simulated_session(camera);
  CalibrationInput unlike = input;
  for (FrameSet& set : unlike.sets)
    if (*set.gain.gain_db == 0)
      change_frames(set, [](RawFrame& frame, int) { lower_black(frame); });
  const NoiseModel expected = calibrate_physics(input, {}, silent_progress()),
                   model = calibrate_physics(unlike, {}, silent_progress());
  EXPECT_EQ(model.black_dn[0], 80);
  for (const std::size_t gain : {0u, 1u}) {
    EXPECT_EQ(model.physics[gain].mu.mean, expected.physics[gain].mu.mean);
    EXPECT_EQ(model.physics[gain].K.mean, expected.physics[gain].K.mean);
    EXPECT_EQ(model.physics[gain].sigma_tl.mean, expected.physics[gain].sigma_tl.mean);
  }
  EXPECT_THAT(model.physics[0].warnings, Contains(AllOf(HasSubstr("a black level of 60 DN"),
                                                        HasSubstr("the black level 60"))));
}

TEST(BlackOfTheFiles, MayDifferWithinASet) {
  const CalibrationInput input = simulated_session(mono_camera());
  CalibrationInput mixed = input;
  change_frames(mixed, [](RawFrame& frame, int i) {
    if (i % 2 == 1) lower_black(frame);
  });
  const NoiseModel expected = calibrate_physics(input, {}, silent_progress()),
                   model = calibrate_physics(mixed, {}, silent_progress());
  EXPECT_EQ(model.physics[0].mu.mean, expected.physics[0].mu.mean);
  EXPECT_EQ(model.physics[0].temporal_sd_dark_dn, expected.physics[0].temporal_sd_dark_dn);
  EXPECT_EQ(model.physics[0].K.mean, expected.physics[0].K.mean);
}

TEST(SessionChecks, ACleanSessionIsLeftAlone) {
  EXPECT_THAT(warnings_of(simulated_session(mono_camera())), ::testing::IsEmpty());
}

// What a gain in ISO is in dB depends on the camera. Said before any frame is read.
TEST(SessionChecks, GainsInTwoUnitsAreRefusedAtOnce) {
  CalibrationInput input;
  for (const GainSetting& gain : {GainSetting{0.0, {}}, GainSetting{{}, 100.0}})
    for (const FrameKind kind : {FrameKind::kBias, FrameKind::kBurst})
      input.sets.push_back({.kind = kind,
                            .gain = gain,
                            .exposure_s = {},
                            .level = {},
                            .count = 4,
                            .load = [](int) -> RawFrame { throw std::logic_error("read"); },
                            .name = ""});
  const auto line = [&] {
    return problem_of(
        [&] { (void)calibrate(input, {}, {ModelKind::kGaussian}, silent_progress()); });
  };
  EXPECT_THAT(line(), AllOf(HasSubstr("0 dB"), HasSubstr("ISO 100")));
  std::erase_if(input.sets, [](const FrameSet& set) { return set.kind == FrameKind::kBias; });
  EXPECT_THAT(line(), AllOf(HasSubstr("0 dB"), HasSubstr("ISO 100")));
}

TEST(SessionChecks, DarkAndFlatFramesExchangedAreSaid) {
  for (const int level : {0, 3}) {
    SimulatedCamera camera = mono_camera();
    camera.flat_frames = 20;
    CalibrationInput input = simulated_session(camera);
    FrameSet& flat = input.sets[static_cast<std::size_t>(1 + level)];
    flat.name = "flat, 12 dB, level 5";
    std::swap(input.sets[0].load, flat.load);
    EXPECT_THAT(warnings_of(input), Contains(AllOf(HasSubstr("flat, 12 dB, level 5"),
                                                   HasSubstr("dark and flat frames exchanged"))))
        << level;
  }
}

TEST(SessionChecks, BiasFramesOfAnotherGainAreNamed) {
  for (const int others : {1, 3, 10}) {
    SimulatedCamera camera = mono_camera();
    camera.flat_levels = 0;
    CalibrationInput input = simulated_session(camera);
    change_frames(input, [others](RawFrame& frame, int i) {
      for (float& v : frame.dn.values())
        if (i < others) v = 79 + 3 * (v - 79);
    });
    EXPECT_THAT(warnings_of(input),
                Contains(AllOf(HasSubstr(others == 1 ? "bias frame 1 of 20" : "bias frame 1, 2"),
                               HasSubstr("another gain"))))
        << others;
  }
}

// Eight standard errors, and 15 %: of 60 sets none, with tails so heavy that the variance of a
// variance does not exist and rows as noisy as the pixels.
TEST(SessionChecks, FramesOfOneGainAreNotBlamed) {
  for (const int frames : {2, 3, 5, 8, 20, 100})
    for (std::uint64_t seed = 0; seed < 10; ++seed) {
      SimulatedCamera camera = mono_camera(seed);
      camera.flat_levels = 0;
      camera.bias_frames = frames;
      PhysicsChannel& channel = camera.gains[0].noise.channels[0];
      channel.lambda = seed % 2 == 0 ? -0.3 : 0.14;
      channel.sigma_row_dn = 3;
      EXPECT_THAT(warnings_of(simulated_session(camera)), Not(Contains(HasSubstr("another gain"))))
          << frames << " " << seed;
    }
}

TEST(SessionChecks, ACopiedFrameIsRefused) {
  for (const std::size_t set : {0u, 2u}) {
    SimulatedCamera camera = mono_camera();
    camera.flat_frames = 4;
    CalibrationInput input = simulated_session(camera);
    input.sets[set].load = [load = input.sets[set].load](int i) {
      RawFrame frame = load(i == 3 ? 1 : i);
      frame.source = "f" + std::to_string(i);
      return frame;
    };
    EXPECT_THAT(problem_of([&] { warnings_of(input); }), HasSubstr("f3: has the same pixels as f1"))
        << set;
  }
}

// One of them would move its channel's mean, and hide in a robust spread.
TEST(SessionChecks, PixelsThatHoldNoLightAreRefused) {
  for (const auto& [value, said] :
       {std::pair{NAN, "has NaN or infinite pixels"},
        {-3.4e38f, "has a pixel of -3.4e+38 DN, beyond 100 times white"},
        {1e20f, "has a pixel of 1e+20 DN"}}) {
    CalibrationInput input = simulated_session(mono_camera());
    change_frames(input.sets[0],
                  [dn = value](RawFrame& frame, int i) { frame.dn(20, 21) = i == 2 ? dn : 90; });
    EXPECT_THAT(problem_of([&] { warnings_of(input); }), HasSubstr(said));
  }
}

TEST(SessionChecks, SaturatedFramesAreNoCopies) {
  CalibrationInput input = simulated_session(mono_camera());
  change_frames(input.sets.back(), [](RawFrame& frame, int) {
    for (float& v : frame.dn.values()) v = 4095;
    frame.dn(3, 3) = 90;
  });
  EXPECT_NO_THROW(warnings_of(input));
}

TEST(SessionChecks, WhyKIsNotKnownIsSaid) {
  SimulatedCamera camera = mono_camera();
  camera.flat_levels = 3;
  CalibrationInput bright = simulated_session(camera);
  for (std::size_t i = 1; i < bright.sets.size(); ++i)
    change_frames(bright.sets[i], [](RawFrame& frame, int) {
      for (float& v : frame.dn.values()) v = std::min(v + 3000, 4095.0F);
    });
  EXPECT_THAT(warnings_of(bright),
              Contains(AllOf(HasSubstr("mono: the gain K is not known: 0 usable"),
                             HasSubstr("3 of 3: mean is"), HasSubstr("above the limit of 70 %"))));
  camera.flat_frames = 1;
  EXPECT_THAT(warnings_of(simulated_session(camera)),
              Contains(HasSubstr("3 of 3: one frame has no temporal variance")));
}

TEST(SessionChecks, AWrongWhiteIsSaid) {
  const auto with_white = [](double white_dn) {
    SimulatedCamera camera = mono_camera();
    camera.flat_levels = 10;
    CalibrationInput input = simulated_session(camera);
    change_frames(input, [white_dn](RawFrame& frame, int) {
      for (float& v : frame.dn.values()) v = std::min(80 + 1.4F * (v - 80), 4095.0F);
      for (float& v : frame.dn.values()) v = std::round(v);
      frame.white_dn = white_dn;
    });
    return warnings_of(input);
  };
  const auto low = HasSubstr("white is too low"), high = HasSubstr("white = 4095 in [sensor]");
  EXPECT_THAT(with_white(4095), AllOf(Not(Contains(low)), Not(Contains(high))));
  EXPECT_THAT(with_white(1023), Contains(AllOf(low, HasSubstr("1023 DN"), HasSubstr("4095 DN"))));
  EXPECT_THAT(with_white(16383), Contains(AllOf(high, HasSubstr("pile up at 4095 DN"))));
}

TEST(SessionChecks, MixedLightOfAFlatIsSaid) {
  CalibrationInput input = simulated_session(mono_camera());
  change_frames(input.sets[4], [](RawFrame& frame, int i) {
    frame.source = "f" + std::to_string(i);
    if (i == 1)
      for (float& v : frame.dn.values()) v = std::round(80 + 0.6F * (v - 80));
  });
  EXPECT_THAT(warnings_of(input), Contains(AllOf(HasSubstr("its frames run from"),
                                                 HasSubstr("(f1) to"), HasSubstr("(f0)"))));
}

// 2304 pixels per channel and ten frames are plenty for a line.
TEST(SessionChecks, ASmallBurstGivesAGaussianModel) {
  FrameSet burst;
  burst.kind = FrameKind::kBurst;
  burst.count = 10;
  const PhysicsNoise noise = polar_gain(12, "mono", 1).noise;
  burst.load = [noise](int i) {
    return testing::ramp_frame(noise, 2600, 48, DrawAddress{7, static_cast<std::uint32_t>(i), 0, 0},
                               true);
  };
  CalibrationInput input;
  input.sets = {burst};
  const NoiseModel model = calibrate(input, {}, {ModelKind::kGaussian}, silent_progress());
  const GaussianCalibration& g = model.gaussian.at(0);
  EXPECT_NEAR(g.slope_dn[0], noise.channels[0].gain_dn_per_e, 4 * g.slope_stderr_dn[0]);
}

TEST(SessionChecks, NoNoiseMakesNoInfinity) {
  const MosaicGeometry geometry(SensorLayout(), 16, 16, 1);
  Image shading(16, 16);
  for (int r = 8; r < 16; ++r)
    for (int c = 0; c < 16; ++c) shading(r, c) = 40;
  PhysicsCalibration out;
  warn_of_light(shading, geometry, 0.0, out);
  ASSERT_EQ(out.warnings.size(), 1u);
  EXPECT_THAT(out.warnings[0],
              AllOf(HasSubstr("over the frame: light leak"), Not(HasSubstr("inf"))));
}

TEST(SessionChecks, NoSpreadIsZeroWithoutASign) {
  SquareMatrix sampling(1);
  sampling(0, 0) = 1;
  const ChannelStatistics s = deviation_statistics({{0.0}, {0.0}, {0.0}}, sampling);
  EXPECT_FALSE(std::signbit(s.spread[0]));
}

TEST(ColumnNoise, IsToldForSynthesisDrawsNone) {
  CalibrationInput input = simulated_session(mono_camera());
  EXPECT_THAT(warnings_of(input), Not(Contains(HasSubstr("its columns change"))));
  change_frames(input, [](RawFrame& frame, int i) {
    for (int c = 0; c < frame.dn.cols(); ++c) {
      const auto offset = static_cast<float>((i * 37 + c * 101 + i * c * 13) % 17 - 8);
      for (int r = 0; r < frame.dn.rows(); ++r) frame.dn(r, c) += std::round(0.5F * offset);
    }
  });
  EXPECT_THAT(warnings_of(input), Contains(HasSubstr("its columns change from frame to frame by")));
}

// In-camera smoothing made K half of the truth without a word.
TEST(Session, FramesThatTheCameraSmoothedAreTold) {
  SimulatedCamera camera = mono_camera();
  camera.rows = camera.cols = 128;
  CalibrationInput input = simulated_session(camera);
  EXPECT_THAT(warnings_of(input), Not(Contains(HasSubstr("noise reduction"))));
  change_frames(input, [](RawFrame& frame, int) {
    const Image sharp = frame.dn;
    for (int r = 0; r < sharp.rows(); ++r)
      for (int c = 1; c + 1 < sharp.cols(); ++c)
        frame.dn(r, c) =
            std::round(0.7F * sharp(r, c) + 0.15F * (sharp(r, c - 1) + sharp(r, c + 1)));
  });
  EXPECT_THAT(warnings_of(input), Contains(AllOf(HasSubstr("0.39"), HasSubstr("in a row"),
                                                 HasSubstr("noise reduction"))));
}

// K was 4 % too large at 20 standard errors without a word.
TEST(Session, CompandedCodesAreTold) {
  SimulatedCamera camera = mono_camera();
  camera.rows = camera.cols = 128;
  camera.shading = 0.05;
  camera.gains = {polar_gain(0, "mono", 1)};
  CalibrationInput input = simulated_session(camera);
  EXPECT_THAT(warnings_of(input), Not(Contains(HasSubstr("companded"))));
  change_frames(input, [](RawFrame& frame, int) {
    for (float& v : frame.dn.values()) {
      const double root = std::round(4 * std::sqrt(static_cast<double>(v))) / 4;
      v = static_cast<float>(std::round(root * root));
    }
  });
  EXPECT_THAT(warnings_of(input), Contains(HasSubstr("companded")));
}

// Frames without any noise: the mean of one and the same code is right to the last digits only.
TEST(Session, FlatsAsDarkAsTheDarkFramesAreNotBelowThem) {
  const auto told = [](double signal_dn) {
    PhysicsCalibration out;
    FlatObservation flat;
    flat.name = "flat";
    flat.sources = {"f.tif"};
    flat.signal_dn = {signal_dn};
    const bool any = warn_of_flats({flat}, {.bias_frames = 2, .step_dn = 1}, out);
    EXPECT_EQ(any, !out.warnings.empty());
    return out.warnings;
  };
  const auto below = Contains(HasSubstr("dark and flat frames exchanged"));
  EXPECT_THAT(told(-1.3e-13), Not(below));
  EXPECT_THAT(told(-0.5), below);
}

TEST(Session, GainsThatKDoesNotFollowAreTold) {
  SimulatedCamera camera = mono_camera();
  camera.gains = {polar_gain(0, "mono", 1), polar_gain(12, "mono", 1)};
  const auto told = [&](double low_db, double high_db) {
    CalibrationInput input = simulated_session(camera);
    for (FrameSet& set : input.sets) set.gain.gain_db = *set.gain.gain_db == 0 ? low_db : high_db;
    change_frames(input, [=](RawFrame& frame, int) {
      frame.gain.gain_db = *frame.gain.gain_db == 0 ? low_db : high_db;
    });
    return calibrate_physics(input, {}, silent_progress()).physics.back().warnings;
  };
  EXPECT_THAT(told(0, 12), Not(Contains(HasSubstr("K "))));
  EXPECT_THAT(told(12, 0), Contains(HasSubstr("exchanged")));
  EXPECT_THAT(told(0, 40), Contains(HasSubstr("is gain_db in decibels")));
}

// White of 12 bits for 10: nothing saturates, and PRNU was missing without a word.
TEST(Session, PrnuThatIsNotKnownIsTold) {
  SimulatedCamera camera = mono_camera();
  CalibrationInput input = simulated_session(camera);
  EXPECT_THAT(warnings_of(input), Not(Contains(HasSubstr("PRNU is not known"))));
  change_frames(input, [](RawFrame& frame, int) { frame.white_dn = 16383; });
  const auto told = warnings_of(input);
  EXPECT_THAT(told, Contains(AllOf(HasSubstr("PRNU is not known"), HasSubstr("white = 16383"))));
}

// Rows in sixteens are none of the groups that are looked for; which they are must be declared.
TEST(Session, RowGroupsThatAreNotFoundAreToBeDeclared) {
  SimulatedCamera camera = mono_camera();
  camera.gains = {polar_gain(12, "mono", 16)};
  EXPECT_THAT(warnings_of(simulated_session(camera)), Contains(HasSubstr("row_group = N")));
}

// Not "not linear, by 3688208604 %".
TEST(Session, ALampThatIsTurnedBetweenLevelsIsTold) {
  CalibrationInput input = simulated_session(mono_camera());
  for (FrameSet& set : input.sets)
    if (set.kind == FrameKind::kFlat) set.exposure_s = 1e-3 * std::sqrt(*set.level + 1.0);
  EXPECT_THAT(warnings_of(input),
              ElementsAre(HasSubstr("mono: the light of the levels does not follow")));
}

// Half of the exposures in milliseconds: a linearity error of 24 %, and nothing to warn about.
TEST(Session, ExposuresInTwoUnitsAreTold) {
  const auto told = [](double unit_of_bright, double every_other = 1) {
    CalibrationInput input = simulated_session(mono_camera());
    for (FrameSet& set : input.sets)
      if (set.kind == FrameKind::kFlat)
        set.exposure_s = 1e-3 * (*set.level + 1) * (*set.level > 5 ? unit_of_bright : 1.0) *
                         (*set.level % 2 == 0 ? every_other : 1.0);
    return warnings_of(input);
  };
  const auto units = HasSubstr("are all exposures in seconds");
  EXPECT_THAT(told(1000), Contains(AllOf(units, HasSubstr("1000 times less light"))));
  EXPECT_THAT(told(1), Not(Contains(units)));
  EXPECT_THAT(told(30), Not(Contains(units)));       // a lamp that was turned down,
  EXPECT_THAT(told(3000, 3), Not(Contains(units)));  // and one that had several brightnesses
}

}  // namespace
}  // namespace malus
