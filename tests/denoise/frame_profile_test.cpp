// What a frame's profile holds of the model's single pixels: by settings, size and place.
#include "malus/denoise/frame_profile.h"

#include "malus/base/error.h"
#include "malus/base/random.h"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using ::testing::HasSubstr;

constexpr int kMappedSide = 32;

// Of a sensor of kMappedSide x kMappedSide: a defect and a dark step where its lower half begins.
NoiseModel mapped_model() {
  NoiseModel model;
  model.layout = SensorLayout::named("polar-mono");
  model.black_dn.assign(4, 0.0);
  model.white_dn = 4000;
  PhysicsCalibration p;
  p.gain.gain_db = 0;
  p.K.mean.assign(4, 0.5);
  p.lambda.mean.assign(4, 0.14);
  p.mu.mean.assign(4, 0.0);
  p.sigma_tl.mean.assign(4, 3.0);
  p.dark_shading_dn = Image(kMappedSide, kMappedSide, 1.0f);
  for (int r = kMappedSide / 2; r < kMappedSide; ++r)
    for (int c = 0; c < kMappedSide; ++c) p.dark_shading_dn(r, c) = -1;
  p.dsnu_dn.assign(4, 1.0);
  model.physics.push_back(p);
  model.defects.push_back({20, 21, "hot", 50});
  return model;
}

RawFrame frame_of_size(int rows, int cols) {
  RawFrame frame;
  frame.source = "frame.tif";
  frame.layout = SensorLayout::named("polar-mono");
  frame.black_dn.assign(4, 0.0);
  frame.white_dn = 4000;
  frame.white_known = true;
  frame.dn = Image(rows, cols, 100.0f);
  return frame;
}

FrameProfile made_of(const RawFrame& frame, const DenoiseSettings& settings = {},
                     std::optional<SensorPlace> place = std::nullopt) {
  return frame_profile(frame, mapped_model(), {0.0, {}}, settings, place);
}

TEST(FrameProfile, HoldsDefectsAndPatternAsTheSettingsAsk) {
  const RawFrame whole = frame_of_size(kMappedSide, kMappedSide);
  const FrameProfile all = made_of(whole);
  ASSERT_NE(all.profile.pattern, nullptr);
  EXPECT_EQ(all.profile.pattern->dark_dn.rows(), kMappedSide);
  EXPECT_EQ(all.profile.defects.places.size(), 1u);
  EXPECT_EQ(all.left_out, "");
  const FrameProfile none = made_of(whole, {.defects = false, .fixed_pattern = false});
  EXPECT_EQ(none.profile.pattern, nullptr);
  EXPECT_TRUE(none.profile.defects.places.empty());
}

TEST(FrameProfile, OfAPartOfTheSensorIsCutOrSaysWhatIsLeftOut) {
  const RawFrame part = frame_of_size(16, 12);
  const FrameProfile cut = made_of(part, {}, SensorPlace{12, 12});
  EXPECT_EQ(cut.left_out, "");
  ASSERT_EQ(cut.profile.defects.places.size(), 1u);
  EXPECT_EQ(cut.profile.defects.places[0].row, 8);
  EXPECT_EQ(cut.profile.defects.places[0].col, 9);
  ASSERT_NE(cut.profile.pattern, nullptr);
  ASSERT_EQ(cut.profile.pattern->dark_dn.cols(), 12);
  EXPECT_GT(cut.profile.pattern->dark_dn(3, 0), 0);
  EXPECT_LT(cut.profile.pattern->dark_dn(4, 0), 0);
  EXPECT_THAT(made_of(part).left_out, HasSubstr("12 x 16 pixels of a sensor of 32 x 32"));
}

TEST(FrameProfile, RefusesAPlaceInTheFramesNameAndAGainInTheModels) {
  try {
    made_of(frame_of_size(16, 12), {}, SensorPlace{1, 0});
    FAIL() << "a place inside a cell";
  } catch (const InputError& error) {
    EXPECT_EQ(error.subject(), "frame.tif");
  }
  NoiseModel model = mapped_model();
  model.physics.push_back(model.physics.front());
  model.physics.back().gain.gain_db = 12;
  try {
    frame_profile(frame_of_size(kMappedSide, kMappedSide), model, {48.0, {}});
    FAIL() << "a gain far outside";
  } catch (const InputError& error) {
    EXPECT_NE(error.subject(), "frame.tif");
  }
}

constexpr int kFrameSide = 256;
constexpr double kPrnu = 0.02, kMapError = 0.01, kDsnuDn = 6;

// PRNU and DSNU, and their maps with sampling error; the frame has `share` of the pattern, and of
// dark shading along the rows.
struct PatternedCamera {
  NoiseModel model;
  RawFrame frame;
};

PatternedCamera patterned_camera(double share, double shading_dn = 0, double dark_error_dn = 0) {
  PatternedCamera camera{mapped_model(), frame_of_size(kFrameSide, kFrameSide)};
  camera.model.defects.clear();
  PhysicsCalibration& p = camera.model.physics.front();
  p.dark_shading_dn = p.prnu_map = Image(kFrameSide, kFrameSide);
  p.prnu.assign(4, kPrnu);
  p.dsnu_dn.assign(4, std::hypot(kDsnuDn, shading_dn / std::sqrt(2.0)));
  RandomSequence random(31, 0, Draw::kOther);
  for (int r = 0; r < kFrameSide; ++r)
    for (int c = 0; c < kFrameSide; ++c) {
      const double response = kPrnu * random.normal(),
                   dark = kDsnuDn * random.normal() + shading_dn * std::sin(c / 9.0),
                   light = 400 + 300 * std::sin(0.05 * r) * std::cos(0.03 * c),
                   own = light * (1 + share * response);
      p.prnu_map(r, c) = static_cast<float>(1 + response + kMapError * random.normal());
      p.dark_shading_dn(r, c) =
          static_cast<float>(dark + (dark_error_dn > 0 ? dark_error_dn * random.normal() : 0));
      camera.frame.dn(r, c) =
          static_cast<float>(own + share * dark + std::sqrt(0.5 * own + 9) * random.normal());
    }
  return camera;
}

// What the first channel's variance at 1000 DN has beside that of frame to frame.
double pattern_variance(const NoiseProfile& profile) {
  const VarianceCurve& curve = profile.channels.front().variance;
  return curve(1000) - curve.temporal()(1000);
}

TEST(FrameProfile, HasThePatternsNoiseUnlessTheFrameShowsNone) {
  const double whole_dn2 = std::pow(1000 * kPrnu, 2) + kDsnuDn * kDsnuDn;
  const auto [model, shown] = patterned_camera(1);
  const RawFrame none = patterned_camera(0).frame, part = frame_of_size(128, 128);
  EXPECT_NEAR(pattern_variance(raw_profile(shown, model, {})) / whole_dn2, 1, 0.05);
  EXPECT_EQ(pattern_variance(raw_profile(none, model, {})), 0);                 // flat-fielded
  EXPECT_DOUBLE_EQ(pattern_variance(raw_profile(part, model, {})), whole_dn2);  // of unknown place
  // What is taken out leaves its sampling error: a fifth of the response's variance.
  EXPECT_NEAR(pattern_variance(frame_profile(shown, model, {}).profile) / std::pow(1000 * kPrnu, 2),
              0.2, 0.02);
  EXPECT_EQ(pattern_variance(frame_profile(none, model, {}).profile), 0);
  EXPECT_DOUBLE_EQ(pattern_variance(frame_profile(part, model, {}).profile), whole_dn2);
  EXPECT_EQ(pattern_variance(frame_profile(part, model, {}, {.fixed_pattern = false}).profile), 0);
  EXPECT_EQ(raw_profile(part, model, {}).pattern, nullptr);
}

// Shading that whole columns have is known to next to nothing, and so leaves nothing. As if it were
// known as little as a pixel, 33 DN² counted as noise, where there were 11.
TEST(FrameProfile, ShadingThatIsTakenOutLeavesNoNoise) {
  constexpr double kShading = 12, kError = 4;
  const auto [model, frame] = patterned_camera(1, kShading, kError);
  const VarianceCurve left = frame_profile(frame, model, {}).profile.channels.front().variance;
  const double of_pixels = std::pow(std::hypot(1 / kDsnuDn, 1 / kError), -2);
  EXPECT_NEAR((left(0) - left.temporal()(0)) / of_pixels, 1, 0.1);
  // Where nothing is taken out, the raw pixels have all of it.
  const VarianceCurve raw = raw_profile(frame, model, {}).channels.front().variance;
  EXPECT_NEAR((raw(0) - raw.temporal()(0)) / (kDsnuDn * kDsnuDn + kShading * kShading / 2), 1, 0.1);
}

// The same place but for four rows: the maps are of other pixels.
TEST(FrameProfile, OfAPlaceWithAnotherPatternDoubtsItAndCountsThePatternAsNoise) {
  const auto [model, shown] = patterned_camera(1);
  RawFrame part = frame_of_size(128, 128);
  for (int r = 0; r < 128; ++r)
    for (int c = 0; c < 128; ++c) part.dn(r, c) = shown.dn(r + 40, c + 64);
  const FrameProfile right = frame_profile(part, model, {}, {}, SensorPlace{40, 64}),
                     wrong = frame_profile(part, model, {}, {}, SensorPlace{44, 64});
  EXPECT_EQ(right.unseen, "");
  EXPECT_THAT(wrong.unseen, HasSubstr("at row 44, column 64"));
  const double whole_dn2 = std::pow(1000 * kPrnu, 2) + kDsnuDn * kDsnuDn;
  EXPECT_DOUBLE_EQ(pattern_variance(wrong.profile), whole_dn2);
  EXPECT_LT(pattern_variance(right.profile), whole_dn2 / 2);
}

}  // namespace
}  // namespace malus
