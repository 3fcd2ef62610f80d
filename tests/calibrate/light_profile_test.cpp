// Light that changes inside the frame from frame to frame: told where it does, and not of noise.
#include "malus/calibrate/internal/light_profile.h"

#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/internal/flat_checks.h"

#include <cmath>
#include <numbers>

#include "simulated_session.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::simulated_session;
using testing::SimulatedCamera;

TEST(LightProfile, FindsWhatBandsOfLightAdd) {
  constexpr int kSize = 128, kFrames = 60;
  constexpr double kLight = 1000, kNoise = 20, kBands = 0.02;
  const MosaicGeometry geometry(SensorLayout::named("bayer-rggb"), kSize, kSize, 1);
  LightProfile bands(geometry, std::vector<double>(4, 80)),
      even(geometry, std::vector<double>(4, 80));
  RandomSequence phase(3, 0, Draw::kParameters);
  for (std::uint32_t f = 0; f < kFrames; ++f) {
    Image frame = testing::white_noise(kSize, kSize, 5, f, kNoise);
    for (float& v : frame.values()) v += static_cast<float>(kLight + 80);
    even.add(frame);
    const double at = 2 * std::numbers::pi * phase.uniform();
    for (int r = 0; r < kSize; ++r)
      for (int c = 0; c < kSize; ++c)
        frame(r, c) += static_cast<float>(kLight * kBands * std::sin(0.1 * r + at));
    bands.add(frame);
  }
  constexpr auto kScaled = FrameAlignment::kMultiplicative;
  const LightChange none = even.change(kNoise * kNoise, kScaled),
                    some = bands.change(kNoise * kNoise, kScaled);
  EXPECT_LT(std::abs(none.rows_dn2), 4 * none.rows_stderr_dn2);
  EXPECT_LT(std::abs(none.columns_dn2), 4 * none.columns_stderr_dn2);
  EXPECT_LT(std::abs(some.columns_dn2), 4 * some.columns_stderr_dn2);
  // A sine's variance, less the part that the frame's mean takes: 2 waves a frame, a few per cent.
  const double truth = kLight * kLight * kBands * kBands / 2;
  EXPECT_NEAR(some.rows_dn2, truth, 0.1 * truth);
  EXPECT_NEAR(bands.change(kNoise * kNoise, FrameAlignment::kAdditive).rows_dn2, truth,
              0.1 * truth);
}

// Masked rows and columns have next to no light, of which their noise is a large share.
TEST(LightProfile, LinesWithoutLightAreNotCompared) {
  constexpr int kSize = 128, kMasked = 8;
  constexpr double kNoise = 20;
  LightProfile profile(MosaicGeometry(SensorLayout(), kSize, kSize, 1), {80});
  for (std::uint32_t f = 0; f < 8; ++f) {
    Image frame = testing::white_noise(kSize, kSize, 6, f, kNoise);
    for (int r = 0; r < kSize; ++r)
      for (int c = 0; c < kSize; ++c)
        frame(r, c) += r < kMasked || c >= kSize - kMasked ? 80.0F : 1080.0F;
    profile.add(frame);
  }
  const LightChange change = profile.change(kNoise * kNoise, FrameAlignment::kMultiplicative);
  EXPECT_EQ(change.row_bands, 30);  // two of 32 are masked
  EXPECT_EQ(change.column_bands, 30);
  EXPECT_LT(std::abs(change.rows_dn2), 4 * change.rows_stderr_dn2);
  EXPECT_LT(std::abs(change.columns_dn2), 4 * change.columns_stderr_dn2);
}

// Light that is lost in the error of a frame's mean tells no share of itself: of such flats more
// than half had been told to change by thousands of per cent.
TEST(LightProfile, DimLightThatIsConstantDoesNotChange) {
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const SimulatedCamera camera = testing::mono_camera(0.4, 0.14, 10.0, 0.5, seed);
    CalibrationInput input = simulated_session(camera);
    for (std::uint32_t level = 0; level < 3; ++level)
      input.sets[1 + level].load = [camera, level](int i) {
        return testing::internal::simulated_frame(
            camera, camera.gains[0], 0.2 + 0.2 * level,
            1000 + 100 * level + static_cast<std::uint32_t>(i));
      };
    const NoiseModel model = calibrate_physics(input, {}, silent_progress());
    EXPECT_THAT(model.physics[0].warnings, Not(Contains(HasSubstr("the light changes")))) << seed;
  }
}

// Strong rows in groups that fill a band: of the so few draws what they add scatters, too. In a
// third of such levels light that changes had been told.
TEST(LightProfile, StrongRowsAreNoLightThatChanges) {
  constexpr int kRows = 128, kCols = 32, kGroup = 4, kLevels = 40;
  constexpr double kLight = 40, kPixel = 4.5, kRow = 2;
  const MosaicGeometry geometry(SensorLayout::named("mono"), kRows, kCols, 1);
  RandomSequence random(7, 0, Draw::kOther);
  std::vector<FlatObservation> flats;
  for (int level = 0; level < kLevels; ++level) {
    FlatObservation flat;
    flat.mean_variance_dn2 = kPixel * kPixel + kRow * kRow;
    LightProfile profile(geometry, {0.0});
    for (int frame = 0; frame < 4; ++frame) {
      Image dn(kRows, kCols);
      double row = 0;
      for (int r = 0; r < kRows; ++r) {
        if (r % kGroup == 0) row = kRow * random.normal();
        for (int c = 0; c < kCols; ++c)
          dn(r, c) = static_cast<float>(kLight + row + kPixel * random.normal());
      }
      profile.add(dn);
      flat.signal_dn.push_back(kLight);
    }
    flat.light = profile.change(flat.mean_variance_dn2, FrameAlignment::kMultiplicative);
    flats.push_back(flat);
  }
  PhysicsCalibration p;
  const bool told = warn_of_flats(flats,
                                  {.row_variance_dn2 = kRow * kRow,
                                   .row_groups = static_cast<double>(kRows) / kGroup,
                                   .white_dn = 4095},
                                  p);
  EXPECT_EQ(told, !p.warnings.empty());
  EXPECT_THAT(p.warnings, Not(Contains(HasSubstr("the light changes"))));
}

}  // namespace
}  // namespace malus
