// Defects that the model lists, and pixels without a number. Truth: a smooth picture known without
// noise, fixed seeds.
#include "malus/denoise/denoiser.h"
#include "malus/noise/model.h"

#include <cmath>
#include <limits>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr float kNoValue = std::numeric_limits<float>::quiet_NaN();

Image light_of_defects(int rows, int cols) {
  Image dn(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      dn(r, c) = static_cast<float>(120 + 80 * std::sin(r * 0.03) * std::cos(c * 0.04));
  return dn;
}

// A hot pixel is filled from its neighbours; one that is not a number stays so.
TEST(Defects, OfTheModelAreFilled) {
  const PhysicsNoise noise = equal_channels("polar-bayer-rggb", {1.5, 0.1, -0.4, 1.8, 0.6});
  const Image clean = light_of_defects(72, 90);
  RawFrame frame = drawn_frame(clean, noise, {.black_dn = 82}, 5);
  frame.dn(30, 41) = 4095;
  frame.dn(34, 41) = 3000;
  frame.dn(50, 60) = kNoValue;
  NoiseProfile profile = profile_of(noise);
  profile.defects = {72, 90, {{30, 41}, {34, 41}, {50, 60}}};
  const Denoised filled = denoise_frame(frame, profile, {.profile = "fast"});
  EXPECT_EQ(filled.defect_pixels, 2);
  EXPECT_EQ(filled.saturated_pixels, 0);
  for (const int row : {30, 34}) EXPECT_NEAR(filled.dn_above_black(row, 41), clean(row, 41), 25);
  EXPECT_TRUE(std::isnan(filled.dn_above_black(50, 60)));
  EXPECT_GT(
      denoise_frame(frame, profile, {.profile = "fast", .defects = false}).dn_above_black(30, 41),
      4000);
  profile.defects.rows = 76;  // of another part of the sensor, or another sensor
  EXPECT_EQ(denoise_frame(frame, profile, {.profile = "fast"}).defect_pixels, 0);
}

// What fills a defect holds the offsets of its neighbours' rows: none of its own is to be taken
// off.
TEST(Defects, AreFilledWhenRowsAreTakenOut) {
  PhysicsNoise noise = equal_channels("polar-mono", {0.2, 0.0, -0.4, 0.8, 6.0});
  const Image clean = Image(128, 128, 5.0F);
  RawFrame frame = drawn_frame(clean, noise, {.black_dn = 82}, 7);
  NoiseProfile profile = profile_of(noise);
  profile.defects = {128, 128, {}};
  for (int r = 3; r < 128; r += 6)
    for (int c = 3; c < 128; c += 13) {
      profile.defects.places.push_back({r, c});
      frame.dn(r, c) = 3000;
    }
  const Denoised result = denoise_frame(frame, profile, {.profile = "fast"});
  EXPECT_EQ(result.defect_pixels, std::ssize(profile.defects.places));
  double defects = 0, all = 0;
  for (const DefectList::Place& p : profile.defects.places)
    defects += std::pow(result.dn_above_black(p.row, p.col) - 5, 2);
  for (const float dn : result.dn_above_black.values()) all += std::pow(dn - 5, 2);
  const double of_defects = std::sqrt(defects / static_cast<double>(result.defect_pixels)),
               of_all = std::sqrt(all / (128 * 128));
  EXPECT_LT(of_defects, 1.5 * of_all);
}

// Far inside of what is no number there is nothing to fill one with. At its edge there is.
TEST(Defects, AmongPixelsThatAreNoNumbersAreNoneEither) {
  const PhysicsNoise noise = equal_channels("mono", {1.5, 0.1, -0.4, 1.8, 0.6});
  RawFrame frame = drawn_frame(light_of_defects(64, 64), noise, {.black_dn = 82}, 5);
  for (int r = 0; r < 64; ++r)
    for (int c = 0; c < 32; ++c) frame.dn(r, c) = kNoValue;
  for (const int col : {15, 31}) frame.dn(32, col) = 3000;
  frame.dn(33, 32) = 1e20f;  // beside the one at the edge
  NoiseProfile profile = profile_of(noise);
  profile.defects = {64, 64, {{32, 15}, {32, 31}}};
  const Denoised result = denoise_frame(frame, profile, {.profile = "fast"});
  EXPECT_EQ(result.defect_pixels, 1);
  EXPECT_EQ(result.nonfinite_pixels, 64 * 32);
  EXPECT_TRUE(std::isnan(result.dn_above_black(32, 15)));
  EXPECT_NEAR(result.dn_above_black(32, 31), 150, 25);
}

// What fills pixels without a number for the filter's sake is no measurement: here it would move
// the means by a quarter, and a channel that holds no number has no mean but 0.
TEST(DenoiseFrame, WhatFillsPixelsWithoutANumberIsNotInTheMeans) {
  constexpr int kSize = 64, kHole = 8;
  const PhysicsNoise noise = equal_channels("polar-mono", {1.5, 0.1, -0.4, 1.8, 0.6});
  Image clean(kSize, kSize, 100.0f);
  for (int r = 0; r < kSize; ++r)
    for (int c = kSize / 2; c < kSize; ++c) clean(r, c) = 300.0f;
  RawFrame frame = drawn_frame(clean, noise, {.black_dn = 82}, 9);
  double sum = 0;
  int count = 0;
  for (int r = 0; r < kSize; ++r)
    for (int c = 0; c < kSize; ++c) {
      const int channel = frame.layout.channel_at(r, c);
      if (c >= kSize / 2 + kHole || channel == 3)
        frame.dn(r, c) = kNoValue;
      else if (channel == 0)
        sum += frame.dn(r, c) - 82, ++count;
    }
  const NoiseProfile profile = profile_of(noise);
  const Denoised result = denoise_frame(frame, profile, {.method = "bm3d", .profile = "fast"});
  EXPECT_NEAR(result.mean_dn.at(0), sum / count - profile.channels[0].bias_dn, 0.5);
  EXPECT_LT(result.mean_dn.at(0), 150);  // 200 with the hole filled
  EXPECT_NEAR(result.mean_shift_dn.at(0), 0, 2);
  EXPECT_EQ(result.mean_dn.at(3), 0);
}

}  // namespace
}  // namespace malus
