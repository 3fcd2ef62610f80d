// Frames that hold a share of the one before: image lag, and what is none.
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/internal/temporal_filter.h"

#include <array>
#include <cmath>

#include "simulated_session.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::simulated_session;
using testing::SimulatedCamera;

SimulatedCamera camera_of_flats(std::uint64_t seed) {
  SimulatedCamera camera;
  camera.seed = seed;
  camera.rows = camera.cols = 256;
  camera.bias_frames = 10;
  camera.flat_levels = 6;
  camera.flat_frames = 4;
  camera.gains.push_back(testing::polar_gain(12, "mono", 1));
  return camera;
}

// Every frame (1 - share) of itself and `share` of the one before (the first: of the last).
CalibrationInput with_frame_before(CalibrationInput input, double share) {
  for (FrameSet& set : input.sets)
    set.load = [load = set.load, count = set.count, share](int i) {
      RawFrame frame = load(i);
      const RawFrame before = load((i + count - 1) % count);
      for (int r = 0; r < frame.dn.rows(); ++r)
        for (int c = 0; c < frame.dn.cols(); ++c)
          frame.dn(r, c) = static_cast<float>(
              std::round((1 - share) * double{frame.dn(r, c)} + share * double{before.dn(r, c)}));
      return frame;
    };
  return input;
}

// Light that differs from channel to channel, pixel to pixel and frame to frame; noise of which a
// fifth is that of no light in the mean channel. Level: of 16 values none beyond 4.5 errors.
TEST(SuccessiveFlats, CorrelateByTheLagWhateverTheLampDoes) {
  constexpr int kSize = 128, kFrames = 9;
  constexpr double kLight = 400, kDark = 100;  // DN² of the noise's two parts, too
  constexpr std::array<double, 4> kColours = {0.5, 1.0, 1.0, 1.5};
  const MosaicGeometry geometry(SensorLayout::named("bayer-rggb"), kSize, kSize, 1);
  const std::vector<double> black(4, 64);
  for (const double lag : {0.0, 0.02}) {
    SuccessiveProducts all;
    for (std::uint64_t seed = 0; seed < 8; ++seed) {
      RandomSequence random(seed, 0, Draw::kScene), pattern(seed, 1, Draw::kScene);
      Image response(kSize, kSize), offset(kSize, kSize), charge(kSize, kSize);
      for (float& v : response.values()) v = static_cast<float>(1 + 0.02 * pattern.normal());
      for (float& v : offset.values()) v = static_cast<float>(20 * pattern.normal());
      SuccessiveFlats flats(geometry, black, offset);
      for (int f = -3; f < kFrames; ++f) {
        const double lamp = 1 + 0.05 * random.normal();
        Image dn(kSize, kSize);
        std::vector<double> mean(4, 0.0);
        for (int r = 0; r < kSize; ++r)
          for (int c = 0; c < kSize; ++c) {
            const auto channel = static_cast<std::size_t>(geometry.channel(r, c));
            const double light = kLight * kColours[channel] * lamp;
            // The lag of the noise alone: that of the light is a change of the lamp.
            const double noise = std::sqrt(light + kDark) * random.normal();
            charge(r, c) = static_cast<float>((1 - lag) * noise + lag * double{charge(r, c)});
            dn(r, c) = static_cast<float>(64 + light * double{response(r, c)} +
                                          double{offset(r, c)} + double{charge(r, c)});
            mean[channel] +=
                (double{dn(r, c)} - 64) / static_cast<double>(geometry.channel_pixels(0));
          }
        if (f >= 0) flats.add(dn, mean);
      }
      const SuccessiveProducts own = flats.products(kLight / (kLight + kDark));
      EXPECT_NEAR(own.correlation(), lag, 4.5 * own.standard_error()) << seed;
      all.merge(own);
    }
    EXPECT_NEAR(all.correlation(), lag, 4.5 * all.standard_error());
    EXPECT_LT(all.standard_error(), 0.003);
  }
}

// K is too small by 1 - (1 - ρ)/(1 + ρ) (1 - ρ/2) of four frames: 5 %.
TEST(ImageLag, IsToldWithWhatItTakesOffTheGain) {
  const CalibrationInput input = with_frame_before(simulated_session(camera_of_flats(1)), 0.02);
  const NoiseModel model = calibrate_physics(input, {}, silent_progress());
  const PhysicsCalibration& out = model.physics.front();
  const double truth = camera_of_flats(1).gains.front().noise.channels.front().gain_dn_per_e;
  EXPECT_NEAR(out.K.mean.front(), 0.95 * truth, 0.01 * truth);
  EXPECT_THAT(out.warnings, Contains(AllOf(HasSubstr("a pixel's noise in a flat correlates by 0.0"),
                                           HasSubstr("image lag"), HasSubstr("% too small"))));
}

TEST(ImageLag, IsNoneOfSoundFramesOrOfOneStaleFrameOrAFilterThatTheDarkFramesTell) {
  const auto said_of_input = [](const CalibrationInput& input) {
    return calibrate_physics(input, {}, silent_progress()).physics.front().warnings;
  };
  const auto told = Contains(HasSubstr("image lag"));
  CalibrationInput sound = simulated_session(camera_of_flats(2));
  EXPECT_THAT(said_of_input(sound), Not(told));
  EXPECT_THAT(said_of_input(with_frame_before(sound, 0.4)),
              AllOf(Not(told), Contains(HasSubstr("the camera mixes frames"))));
  FrameSet& brightest = sound.sets.back();  // its third frame is half the second
  brightest.load = [load = brightest.load](int i) {
    RawFrame frame = load(i);
    if (i != 2) return frame;
    const RawFrame before = load(1);
    for (int r = 0; r < frame.dn.rows() / 2; ++r)
      for (int c = 0; c < frame.dn.cols(); ++c) frame.dn(r, c) = before.dn(r, c);
    return frame;
  };
  EXPECT_THAT(said_of_input(sound), Not(told));
}

// A mixture correlates by 1 at most: 2.9 was told of pixels that go on in one direction.
TEST(SuccessiveFrames, ADriftIsNoMixture) {
  constexpr int kSide = 64;
  SuccessiveFrames frames({SensorLayout::named("mono"), kSide, kSide, 1});
  RandomSequence random(5, 0, Draw::kScene, 9);
  Image slope(kSide, kSide);
  for (float& v : slope.values()) v = static_cast<float>(3 * random.normal());
  for (int f = 0; f < 24; ++f) {
    Image read(kSide, kSide);
    for (std::size_t i = 0; i < read.size(); ++i)
      read.values()[i] = static_cast<float>(f * double{slope.values()[i]} + 0.5 * random.normal());
    frames.add(read);
  }
  EXPECT_GT(frames.correlation(), 2);
  PhysicsCalibration out;
  warn_of_temporal_filter(frames, out);
  EXPECT_THAT(out.warnings, ::testing::ElementsAre(HasSubstr("a drift")));
}

// A frame of another gain beside two of less noise made 0.5 of all ten: their differences from it
// are alike.
TEST(SuccessiveFrames, AFrameOfMuchNoiseIsNoMixture) {
  constexpr int kSide = 64;
  for (const int odd : {3, 4, 5}) {
    SuccessiveFrames frames({SensorLayout::named("mono"), kSide, kSide, 1});
    RandomSequence random(6, 0, Draw::kScene, 9);
    for (int f = 0; f < 10; ++f) {
      Image read(kSide, kSide);
      for (float& v : read.values()) v = static_cast<float>((f == odd ? 6 : 1) * random.normal());
      frames.add(read);
    }
    PhysicsCalibration out;
    warn_of_temporal_filter(frames, out);
    EXPECT_THAT(out.warnings, ::testing::IsEmpty()) << odd;
  }
}

// Of a few pixels that change at all, all may happen to change in the first of three frames alone:
// that was a correlation of 1.00 ± 0, and a camera that mixes frames.
TEST(SuccessiveFrames, AHandfulOfChangesTellsNothing) {
  constexpr int kSize = 128, kTriples = 8;
  for (const int changes : {2, 40}) {  // per triple
    SuccessiveFrames frames(MosaicGeometry(SensorLayout::named("mono"), kSize, kSize, 1));
    for (int f = 0; f < 3 * kTriples; ++f) {
      Image dn(kSize, kSize);
      for (int i = 0; f % 3 == 0 && i < changes; ++i) dn((5 * f + 3 * i) % kSize, 3 * i) = 1;
      frames.add(dn);
    }
    EXPECT_GT(frames.correlation(), 0.9) << changes;
    EXPECT_EQ(mixes_frames(frames), changes > 2) << changes;
  }
}

}  // namespace
}  // namespace malus
