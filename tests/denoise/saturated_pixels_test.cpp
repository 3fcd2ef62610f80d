// Frames whose white nobody tells: known light, noise from the generative law, fixed seeds.
#include "malus/denoise/saturated_pixels.h"

#include "malus/denoise/denoiser.h"
#include "malus/denoise/estimate_noise.h"
#include "malus/noise/model.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "denoise/drawn_frame.h"
#include "problem_of.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using ::malus::testing::problem_of;
using ::testing::HasSubstr;

constexpr float kEvenDn = 500;

// Float pixels as they are read from a file that tells no white: the largest of them stands for it.
void forget_white(RawFrame& frame) {
  const auto& values = frame.dn.values();
  frame.white_dn = *std::max_element(values.begin(), values.end());
  frame.white_known = false;
}

PhysicsNoise even_noise() { return equal_channels("polar-mono", {0.5, 0.1, 0.0, 1.2, 0.0}); }

RawFrame even_light() {
  return drawn_frame(Image(96, 96, kEvenDn), even_noise(), {.black_dn = 82}, 12);
}

Denoised denoised_with_error(const RawFrame& frame) {
  return denoise_frame(frame, profile_of(even_noise()), {.profile = "fast"}, silent_progress(),
                       true);
}

TEST(SaturatedPixels, TheBrightestOfUnknownWhiteIsDenoisedAsTheOthers) {
  RawFrame frame = even_light();
  const Denoised known = denoised_with_error(frame);
  forget_white(frame);
  const Denoised result = denoised_with_error(frame);
  EXPECT_EQ(result.saturated_pixels, 0);
  for (std::size_t i = 0; i < frame.dn.size(); ++i) {
    ASSERT_NEAR(result.dn_above_black.values()[i], known.dn_above_black.values()[i], 0.5) << i;
    ASSERT_TRUE(std::isfinite(result.variance_dn2->values()[i])) << i;
  }
}

TEST(SaturatedPixels, APileAtTheTopIsSaturatedWhoeverTellsWhite) {
  RawFrame frame = even_light();
  for (float& v : frame.dn.values()) v = std::min(v, 82 + kEvenDn + 10);
  forget_white(frame);
  const Denoised result = denoised_with_error(frame);
  const auto clipped = std::count(frame.dn.values().begin(), frame.dn.values().end(),
                                  static_cast<float>(frame.white_dn));
  ASSERT_GT(clipped, 1000);
  EXPECT_EQ(result.saturated_pixels, clipped);
  for (std::size_t i = 0; i < frame.dn.size(); ++i)
    ASSERT_EQ(std::isnan(result.variance_dn2->values()[i]), frame.dn.values()[i] == frame.white_dn);
}

TEST(SaturatedPixels, PilesAreEachChannelsOwn) {
  Image dn = even_light().dn;
  for (int r = 0; r < dn.rows(); r += 2)
    for (int c = 0; c < dn.cols(); c += 2) dn(r, c) = std::min(dn(r, c), 580.0f);
  const std::vector<float> piles_dn = piled_up_dn(dn, SensorLayout::named("polar-mono"));
  EXPECT_EQ(piles_dn[0], 580);
  for (std::size_t k = 1; k < 4; ++k) EXPECT_TRUE(std::isinf(piles_dn[k])) << k;
}

TEST(SaturatedPixels, AWhiteThatLeavesNoRangeIsRefused) {
  RawFrame dark = even_light();
  for (float& v : dark.dn.values()) v -= 1000;
  forget_white(dark);
  EXPECT_THAT(problem_of([&] { denoised_with_error(dark); }),
              HasSubstr("no pixel is above black, and white is not known"));
  RawFrame endless = even_light();
  endless.white_dn = 1e300;
  EXPECT_THAT(problem_of([&] { denoised_with_error(endless); }),
              HasSubstr("white 1e+300 DN is above all that cameras count"));
  RawFrame broken = even_light();
  broken.dn(3, 4) = 3e38f;
  forget_white(broken);
  EXPECT_THAT(problem_of([&] { denoised_with_error(broken); }),
              HasSubstr("white is not known, and the largest pixel is 3e+38 DN"));
}

TEST(SaturatedPixels, BlackLevelsThatAreNotOnePerChannelAreRefused) {
  RawFrame frame = even_light();
  const auto said = [&](std::vector<double> black_dn) {
    frame.black_dn = std::move(black_dn);
    const std::string problem = problem_of([&] { denoised_with_error(frame); });
    EXPECT_EQ(problem_of([&] { (void)estimate_profile(frame); }), problem);
    EXPECT_EQ(problem_of([&] { (void)is_without_noise(frame); }), problem);
    return problem;
  };
  EXPECT_THAT(said({}), HasSubstr("0 black levels for the 4 channels of polar-mono"));
  EXPECT_THAT(said({0}), HasSubstr("1 black levels for the 4 channels"));
  EXPECT_THAT(said({0, 0, std::nan(""), 0}), HasSubstr("black nan DN is not below white"));
}

// Black levels far apart: a channel of low black has light above the range of the others.
TEST(SaturatedPixels, AChannelIsBrightUpToItsOwnWhite) {
  const PhysicsNoise noise = equal_channels("polar-mono", {0.05, 0.14, 0.0, 0.3, 0.0});
  constexpr float kBlackDn[] = {0, 20, 300, 600}, kBelowWhiteDn = 150;
  Image clean(128, 128);
  for (int r = 0; r < clean.rows(); ++r)
    for (int c = 0; c < clean.cols(); ++c)
      clean(r, c) = 4095 - kBelowWhiteDn - kBlackDn[noise.layout.channel_at(r, c)];
  RawFrame frame = drawn_frame(clean, noise, {}, 12);
  frame.black_dn.assign(std::begin(kBlackDn), std::end(kBlackDn));
  for (int r = 0; r < clean.rows(); ++r)
    for (int c = 0; c < clean.cols(); ++c)
      frame.dn(r, c) += kBlackDn[noise.layout.channel_at(r, c)];
  for (const char* method : {"nl-ridge", "vst-bm3d"}) {
    const Denoised result =
        denoise_frame(frame, profile_of(noise), {.method = method, .profile = "fast"});
    EXPECT_EQ(result.saturated_pixels, 0);
    double sums[4] = {};
    for (int r = 0; r < clean.rows(); ++r)
      for (int c = 0; c < clean.cols(); ++c)
        sums[noise.layout.channel_at(r, c)] += result.dn_above_black(r, c) - clean(r, c);
    // The noise has a deviation of 14 DN, and the mean of 4096 pixels one of 0.22 DN.
    for (const double sum : sums) EXPECT_NEAR(sum / 4096, 0, 1.0) << method;
  }
}

}  // namespace
}  // namespace malus
