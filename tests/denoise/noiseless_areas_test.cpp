// Frames with areas that show no noise: masked, crushed, filled or covered. Truth: pictures known
// without noise, noise from the generative law (synthesize/exact.h), fixed seeds.
#include "malus/denoise/internal/noiseless_areas.h"

#include "malus/denoise/denoiser.h"
#include "malus/denoise/estimate_noise.h"
#include "malus/noise/model.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kFrameRows = 256, kFrameCols = 320;
constexpr float kDarkDn = 82;

PhysicsNoise rounding_camera(const char* layout, double row_dn = 0) {
  return equal_channels(layout, {1.5, 0.14, 0.0, 1.8, row_dn});
}

RawFrame rounded_frame(const PhysicsNoise& noise) {
  Image clean(kFrameRows, kFrameCols);
  for (int r = 0; r < kFrameRows; ++r)
    for (int c = 0; c < kFrameCols; ++c)
      clean(r, c) = static_cast<float>(300 * (1 + 0.2 * std::sin(c / 40.0) * std::cos(r / 50.0)));
  RawFrame frame = drawn_frame(clean, noise, {.black_dn = kDarkDn}, 3);
  frame.black_known = true;
  for (float& v : frame.dn.values()) v = std::round(v);
  return frame;
}

template <class Where>
RawFrame with_area(RawFrame frame, float value, const Where& where) {
  for (int r = 0; r < frame.dn.rows(); ++r)
    for (int c = 0; c < frame.dn.cols(); ++c)
      if (where(r, c)) frame.dn(r, c) = value;
  return frame;
}

auto columns_below(int end) {
  return [end](int, int col) { return col < end; };
}

auto rows_below(int end) {
  return [end](int row, int) { return row < end; };
}

bool beside_disc(int row, int col) {
  return std::hypot(row - kFrameRows / 2, col - kFrameCols / 2) > 0.48 * kFrameRows;
}

// The estimated deviation at 300 DN over the true one, mean over the channels.
double times_true(const RawFrame& frame) {
  const Estimate<PictureNoise> noise = estimate_profile(frame);
  if (!noise) return std::numeric_limits<double>::quiet_NaN();
  double sum = 0;
  for (const ChannelProfile& channel : noise->profile.channels)
    sum += std::sqrt(channel.variance(300) /
                     pixel_variance_dn2(rounding_camera("mono").channels[0], 300, 1));
  return sum / frame.layout.channels();
}

std::int64_t noiseless_in(const RawFrame& frame) {
  const std::vector<float> white(static_cast<std::size_t>(frame.layout.channels()),
                                 static_cast<float>(frame.white_dn));
  const std::vector<bool> mask = noiseless_areas(frame.dn, frame.layout, white);
  return std::count(mask.begin(), mask.end(), true);
}

// With them the deviation comes out down to a fortieth of the true one.
TEST(NoiselessAreas, AreNoNoiseOfThePicture) {
  for (const char* layout : {"mono", "bayer-rggb", "polar-bayer-rggb"}) {
    const RawFrame whole = rounded_frame(rounding_camera(layout));
    EXPECT_EQ(noiseless_in(whole), 0);
    for (const float value : {0.0f, kDarkDn, 2000.0f}) {
      for (const int columns : {6, 20, 64})
        EXPECT_NEAR(times_true(with_area(whole, value, columns_below(columns))), 1, 0.06)
            << layout << ' ' << value << ' ' << columns;
      EXPECT_NEAR(times_true(with_area(whole, value, rows_below(30))), 1, 0.06) << layout << value;
    }
    if (whole.layout.channels() > 4) continue;  // too few blocks are left
    EXPECT_NEAR(times_true(with_area(whole, 0, columns_below(160))), 1, 0.06) << layout;
    EXPECT_NEAR(times_true(with_area(whole, 0, beside_disc)), 1, 0.06) << layout;
  }
}

// A shadow of 8 bits whose black level was taken off, and with it the noise.
TEST(NoiselessAreas, AShadowThatWasCrushedIsNone) {
  const PhysicsNoise noise = equal_channels("polar-mono", {0.6, 0.14, 0.0, 1.0, 0.0});
  Image clean(kFrameRows, kFrameCols);
  for (int r = 0; r < kFrameRows; ++r)
    for (int c = 0; c < kFrameCols; ++c)
      clean(r, c) = static_cast<float>((c < 96 ? 5 : 100) * (1 + 0.1 * std::sin(r / 30.0)));
  RawFrame frame = drawn_frame(clean, noise, {.white_dn = 255}, 7);
  frame.black_known = true;
  frame.bits = 8;
  for (float& v : frame.dn.values()) v = std::clamp(std::round(v - 12), 0.0f, 255.0f);
  const Estimate<PictureNoise> found = estimate_profile(frame);
  ASSERT_TRUE(found);
  for (const ChannelProfile& channel : found->profile.channels)
    EXPECT_NEAR(std::sqrt(channel.variance(88) / pixel_variance_dn2(noise.channels[0], 100, 1)), 1,
                0.1);
}

TEST(NoiselessAreas, TellNothingAgainstAModel) {
  const PhysicsNoise noise = rounding_camera("polar-mono");
  for (const float value : {0.0f, kDarkDn}) {
    const Denoised result =
        denoise_frame(with_area(rounded_frame(noise), value, columns_below(100)), profile_of(noise),
                      {.profile = "fast"});
    ASSERT_TRUE(result.noise);
    EXPECT_NEAR(result.noise->frame_sd_dn, result.noise->profile_sd_dn,
                0.1 * result.noise->profile_sd_dn);
    EXPECT_EQ(noise_complaint(*result.noise), "");
  }
}

// Offsets of the rows are found as if nothing was masked, and the mask gets none.
TEST(NoiselessAreas, HaveNoRowNoise) {
  const PhysicsNoise noise = rounding_camera("polar-mono", 8.0);
  const RawFrame whole = rounded_frame(noise);
  const Denoised result = denoise_frame(with_area(whole, kDarkDn, columns_below(200)),
                                        profile_of(noise), {.profile = "fast"});
  EXPECT_NEAR(result.row_noise_removed_dn / 8.0, 1, 0.15);
  for (int r = 0; r < kFrameRows; ++r) EXPECT_NEAR(result.dn_above_black(r, 50), 0, 0.5) << r;
}

// Small noise rounds to areas of one value too, at every value; and what is black all over stays.
TEST(NoiselessAreas, ThatRoundingMakesTellOfTheNoise) {
  const PhysicsNoise noise = equal_channels("mono", {0.002, 0.14, 0.0, 0.06, 0.0});
  Image clean(kFrameRows, kFrameCols);
  for (int r = 0; r < kFrameRows; ++r)
    for (int c = 0; c < kFrameCols; ++c) clean(r, c) = 2 + 10 * static_cast<float>(c) / kFrameCols;
  RawFrame frame = drawn_frame(clean, noise, {}, 4);
  for (float& v : frame.dn.values()) v = std::round(v);
  EXPECT_EQ(noiseless_in(frame), 0);
  EXPECT_EQ(noiseless_in(with_area(frame, 7, columns_below(kFrameCols))), 0);
}

// Of half of the pixels at 0 noise makes no such area.
TEST(NoiselessAreas, ThatNoiseCutsOffAreNone) {
  RawFrame frame = drawn_frame(Image(kFrameRows, kFrameCols, 0.0f), rounding_camera("mono"), {}, 4);
  for (float& v : frame.dn.values()) v = std::max(std::round(v), 0.0f);
  EXPECT_EQ(noiseless_in(frame), 0);
}

}  // namespace
}  // namespace malus
