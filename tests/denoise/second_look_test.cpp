// What the result of a picture says of noise that was estimated from it. Truth: the noise that the
// pictures are drawn with, fixed seeds.
#include "malus/denoise/internal/second_look.h"

#include "malus/base/random.h"
#include "malus/denoise/estimate_noise.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using internal::Look;
using internal::share_that_result_shows;

constexpr double kGain = 1.2;  // DN/e-
constexpr float kPaper = 3000;

PhysicsNoise looked_at_noise(const char* layout) {
  return equal_channels(layout, {kGain, kNormalLambda, 0, 0, 0});
}

// Lines of marks of two pixels on paper whose light falls off to a third.
Image shaded_page(int side) {
  RandomSequence random(4, 0, Draw::kScene);
  Image light(side, side, 1.0f);
  const auto draw = [&](int row, int col, int rows, int cols) {
    for (int r = row; r < std::min(row + rows, side); ++r)
      for (int c = col; c < std::min(col + cols, side); ++c) light(r, c) = 0.12f;
  };
  for (int row = 3; row < side; row += 14)
    for (int col = 3; col < side; col += 8)
      for (int mark = 0; mark < 3; ++mark) {
        const int down = static_cast<int>(8 * random.uniform()),
                  right = static_cast<int>(5 * random.uniform());
        if (random.uniform() < 0.5)
          draw(row + down, col, 2, 6);
        else
          draw(row, col + right, 10, 2);
      }
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c)
      light(r, c) *=
          kPaper * (0.3f + 0.7f * static_cast<float>(r + c) / static_cast<float>(2 * side));
  return light;
}

Image soft_waves(int side) {
  Image light(side, side);
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c)
      light(r, c) = kPaper * static_cast<float>(0.5 + 0.3 * std::sin(c / 9.0) * std::cos(r / 11.0));
  return light;
}

Image board_of_light(int side) {
  Image light(side, side);
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c)
      light(r, c) = (r / 8 + c / 8) % 2 ? 0.2f * kPaper : 0.8f * kPaper;
  return light;
}

Image slanted_stripes(int side) {
  Image light(side, side);
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c)
      light(r, c) = std::fmod(0.906 * c + 0.423 * r, 16.0) < 8 ? 0.1f * kPaper : 0.8f * kPaper;
  return light;
}

Image white_texture(int side) {
  RandomSequence random(7, 0, Draw::kScene);
  Image light(side, side);
  for (float& value : light.values())
    value = kPaper * static_cast<float>(0.2 + 0.6 * random.uniform());
  return light;
}

// The camera's own, and as much more.
NoiseProfile told_noise(const PhysicsNoise& camera, double factor) {
  NoiseProfile profile;
  profile.layout = camera.layout;
  profile.estimated_from_picture = true;
  for (std::size_t k = 0; k < camera.channels.size(); ++k)
    profile.channels.push_back(
        {.variance = VarianceCurve::affine(factor * kGain, 0), .gain_dn_per_e = kGain});
  return profile;
}

class SecondLook : public ::testing::TestWithParam<const char*> {};

TEST_P(SecondLook, TheRightNoiseIsNotContradicted) {
  const PhysicsNoise camera = looked_at_noise(GetParam());
  for (const Image& scene : {shaded_page(256), soft_waves(256), board_of_light(256)}) {
    const auto share =
        share_that_result_shows(drawn_frame(scene, camera, {200}, 5), told_noise(camera, 1));
    EXPECT_FALSE(share) << *share;
  }
}

// What repeats is averaged, and no noise is kept; of a page a part is.
TEST_P(SecondLook, TooMuchNoiseIsLoweredAndNotBelowTheRightOne) {
  const PhysicsNoise camera = looked_at_noise(GetParam());
  for (const double factor : {1.5, 2.0}) {
    const auto lowered = [&](const Image& scene) {
      return factor * share_that_result_shows(drawn_frame(scene, camera, {200}, 5),
                                              told_noise(camera, factor))
                          .value_or(1);
    };
    EXPECT_NEAR(lowered(board_of_light(256)), 1.1, 0.12) << factor;
    const double of_page = lowered(shaded_page(256));
    EXPECT_GT(of_page, 0.95);
    EXPECT_LT(of_page, 0.8 * factor);
  }
}

// All of crisp stripes was taken for noise: the result is the picture.
TEST_P(SecondLook, NoiseThatIsAllOfThePictureIsLowered) {
  const PhysicsNoise camera = looked_at_noise(GetParam());
  const RawFrame frame = drawn_frame(slanted_stripes(256), camera, {200}, 5);
  const auto share = share_that_result_shows(frame, told_noise(camera, 60), Look::kGlance);
  ASSERT_TRUE(share);
  EXPECT_GT(60 * *share, 0.8);
  EXPECT_LT(60 * *share, 6);
}

// The result of texture as fine as the pixels is the picture too, but with less noise it still is.
TEST_P(SecondLook, TheNoiseOfATextureThatHidesItIsLeft) {
  const PhysicsNoise camera = looked_at_noise(GetParam());
  const RawFrame frame = drawn_frame(white_texture(256), camera, {200}, 5);
  for (const Look look : {Look::kWhole, Look::kGlance}) {
    const auto share = share_that_result_shows(frame, told_noise(camera, 1), look);
    EXPECT_FALSE(share) << *share;
  }
}

TEST_P(SecondLook, AGlanceLeavesNoiseThatIsNotAllOfThePicture) {
  const PhysicsNoise camera = looked_at_noise(GetParam());
  for (const Image& scene : {shaded_page(256), board_of_light(256)}) {
    const RawFrame frame = drawn_frame(scene, camera, {200}, 5);
    EXPECT_FALSE(share_that_result_shows(frame, told_noise(camera, 2), Look::kGlance));
  }
}

INSTANTIATE_TEST_SUITE_P(Layouts, SecondLook,
                         ::testing::Values("mono", "bayer-rggb", "polar-mono", "polar-bayer-rggb"));

// Its dark half shows half of what is told, its bright one four fifths.
TEST(SecondLook, ALawOfAnotherShapeIsLeft) {
  const PhysicsNoise camera = looked_at_noise("bayer-rggb");
  Image scene = board_of_light(256);
  for (int r = 0; r < scene.rows(); ++r)
    for (int c = 0; c < 128; ++c) scene(r, c) *= 0.3f;
  NoiseProfile told = told_noise(camera, 1);
  for (ChannelProfile& channel : told.channels)
    channel.variance = VarianceCurve::affine(0.93 * kGain, 400);
  const auto share = share_that_result_shows(drawn_frame(scene, camera, {200}, 5), told);
  EXPECT_FALSE(share) << *share;
}

TEST(SecondLook, MaskedPixelsTellNothing) {
  const PhysicsNoise camera = looked_at_noise("bayer-rggb");
  RawFrame page = drawn_frame(shaded_page(320), camera, {200}, 5);
  const NoiseProfile told = told_noise(camera, 1.6);
  const auto whole = share_that_result_shows(page, told);
  ASSERT_TRUE(whole);
  for (int r = 0; r < page.dn.rows(); ++r) std::fill_n(page.dn.row(r), 120, 1000.0f);
  const auto part = share_that_result_shows(page, told);
  ASSERT_TRUE(part);
  EXPECT_NEAR(*part, *whole, 0.05);
}

// Texture between marks was counted as noise.
TEST(SecondLook, LowersWhatAPageShows) {
  const PhysicsNoise camera = looked_at_noise("bayer-rggb");
  RawFrame page = drawn_frame(shaded_page(320), camera, {200}, 6);
  page.black_known = true;
  const Estimate<PictureNoise> first = estimate_profile(page);
  ASSERT_TRUE(first);
  const PictureNoise second = require_estimate(page, "");
  const double right = kGain * 1000, before = first->profile.channels[1].variance(1000),
               after = second.profile.channels[1].variance(1000);
  EXPECT_GT(before / right, 1.4);
  EXPECT_NEAR(after / right, 1.1, 0.1);
  EXPECT_EQ(first->result_share, 1);
  EXPECT_NEAR(second.result_share, after / before, 1e-9);
  EXPECT_NEAR(second.relative_error,
              std::hypot(first->relative_error, 0.2 * (1 - second.result_share)), 1e-9);
  EXPECT_NEAR(second.deviation_dn, first->deviation_dn * std::sqrt(after / before), 1e-6);
  EXPECT_NE(second.trust.find("a first result left"), std::string::npos) << second.trust;
}

// Noise of less than a code is not what residuals tell; that of rounding stays whatever they do.
TEST(SecondLook, LeavesTheNoiseOfFewCodes) {
  for (const float paper : {12.0f, 120.0f}) {
    Image light = shaded_page(320);
    for (float& v : light.values()) v *= paper / kPaper;
    RawFrame page =
        drawn_frame(light, equal_channels("bayer-rggb", {0.02, kNormalLambda, 0, 0, 0}), {4}, 7);
    for (float& v : page.dn.values()) v = std::round(v);
    page.black_known = true;
    page.bits = 8;
    const PictureNoise noise = require_estimate(page, "");
    const bool lowered = noise.result_share < 1;
    EXPECT_EQ(lowered, paper == 120) << noise.trust;
    for (const ChannelProfile& channel : noise.profile.channels)
      EXPECT_GE(channel.variance(0), 1 / 12.0);
  }
}

TEST(SecondLook, LoweredNoiseKeepsThatOfRounding) {
  NoiseProfile told = told_noise(looked_at_noise("bayer-rggb"), 1);
  told.step_dn = 16;
  for (ChannelProfile& channel : told.channels)
    channel.variance = VarianceCurve::affine(2, 16 * 16 / 12.0);
  for (const ChannelProfile& channel : internal::with_scaled_variances(told, 0.05).channels) {
    EXPECT_NEAR(channel.variance(0), 16 * 16 / 12.0, 1e-9);
    EXPECT_NEAR(channel.variance(1000), 100 + 16 * 16 / 12.0, 1e-9);
  }
}

}  // namespace
}  // namespace malus
