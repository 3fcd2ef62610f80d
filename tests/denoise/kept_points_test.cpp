// Truth: light known without noise, noise from the generative law (synthesize/exact.h), fixed
// seeds.
#include "malus/denoise/internal/kept_points.h"

#include "malus/base/parallel.h"
#include "malus/denoise/denoiser.h"
#include "malus/noise/model.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kSide = 192;
constexpr float kGround = 20;  // e-, and DN
constexpr double kRead = 2.5;

PhysicsNoise camera_of(const char* layout, double lambda = 0.14) {
  const double scale = kRead / std::sqrt(tukey_lambda_variance(lambda));
  return equal_channels(layout, {1.0, lambda, 0.0, scale, 0.0});
}

struct Point {
  int row, col;
};

// Alone: no two within two cells of each other.
std::vector<Point> places() {
  std::vector<Point> list;
  for (int r = 10; r < kSide - 10; r += 17)
    for (int c = 10; c < kSide - 10; c += 19) list.push_back({r + c % 5, c + r % 3});
  return list;
}

Image ground_with(float peak, const std::vector<Point>& points) {
  Image light(kSide, kSide);
  std::ranges::fill(light.values(), kGround);
  for (const Point& p : points) light(p.row, p.col) += peak;
  return light;
}

Denoised filtered(const RawFrame& frame, const PhysicsNoise& noise,
                  const char* method = "nl-ridge") {
  const bool variance = std::string(method) == "nl-ridge" || std::string(method) == "bm3d";
  return denoise_frame(frame, profile_of(noise), {.method = method, .profile = "fast"},
                       silent_progress(), variance);
}

class BrightPoints : public testing::TestWithParam<std::tuple<const char*, const char*, float>> {};

TEST_P(BrightPoints, KeepTheirLightAndStateTheirError) {
  const auto& [layout, method, peak] = GetParam();
  const std::vector<Point> points = places();
  const PhysicsNoise noise = camera_of(layout);
  const Denoised result =
      filtered(drawn_frame(ground_with(peak, points), noise, {}, 3), noise, method);
  double kept = 0, squares = 0;
  for (const Point& p : points) {
    const double dn = result.dn_above_black(p.row, p.col);
    kept += (dn - kGround) / peak;
    squares += std::pow(dn - kGround - peak, 2) / (*result.variance_dn2)(p.row, p.col);
  }
  const auto count = static_cast<double>(points.size());
  EXPECT_NEAR(kept / count, 1, 0.03);
  EXPECT_NEAR(squares / count, 1, 5 * std::sqrt(2 / count));
  EXPECT_GE(result.kept_pixels, std::ssize(points));
  EXPECT_LT(result.kept_pixels, 2 * std::ssize(points));
}

// 27 and 60 deviations of the noise around: the filter keeps some light of the brighter.
INSTANTIATE_TEST_SUITE_P(
    Layouts, BrightPoints,
    testing::Combine(testing::Values("mono", "polar-mono", "bayer-rggb", "polar-bayer-rggb"),
                     testing::Values("nl-ridge", "bm3d"), testing::Values(140.0f, 310.0f)));

// Frames so large that their noise reaches beyond four deviations: whose lower tail, in units of
// the noise of the darker pixels that it makes, is five and more.
TEST(KeptPoints, AreNoneOfTheNoise) {
  for (const double lambda : {0.14, -0.1})
    for (const float electrons : {0.5f, 5.0f, 18.0f, 100.0f})
      for (const std::uint64_t seed : {1, 2}) {
        const PhysicsNoise noise = camera_of("polar-mono", lambda);
        Image light(512, 512);
        std::ranges::fill(light.values(), electrons);
        EXPECT_EQ(filtered(drawn_frame(light, noise, {}, seed), noise).kept_pixels, 0)
            << lambda << " " << electrons << " " << seed;
      }
}

// A frame noisier than its model would otherwise come back with its noise.
TEST(KeptPoints, AreNoneOfNoiseThatTheModelUnderstates) {
  const PhysicsNoise noise = camera_of("polar-mono");
  PhysicsNoise told = noise;
  for (PhysicsChannel& channel : told.channels) {
    channel.gain_dn_per_e /= 4;
    channel.sigma_tl_dn /= 2;
  }
  const Image light = ground_with(0, {});
  EXPECT_LT(filtered(drawn_frame(light, noise, {}, 4), told).kept_pixels, 10);
}

TEST(KeptPoints, LeaveSaturatedPixelsAndBaselinesAlone) {
  const PhysicsNoise noise = camera_of("mono");
  const std::vector<Point> points = places();
  RawFrame frame = drawn_frame(ground_with(500, points), noise, {.white_dn = 200}, 5);
  for (float& dn : frame.dn.values()) dn = std::min(dn, 200.0f);
  const Denoised result = filtered(frame, noise);
  EXPECT_EQ(result.saturated_pixels, std::ssize(points));
  for (const Point& p : points) {
    EXPECT_FLOAT_EQ(result.dn_above_black(p.row, p.col), 200);
    EXPECT_TRUE(std::isnan((*result.variance_dn2)(p.row, p.col)));
  }
  const RawFrame open = drawn_frame(ground_with(140, points), noise, {}, 5);
  EXPECT_EQ(filtered(open, noise, "vst-bm3d").kept_pixels, 0);
}

// What stands in their place was measured by nobody.
TEST(KeptPoints, AreNoFilledPixels) {
  const PhysicsNoise noise = camera_of("mono");
  Image light(kSide, kSide);  // so fine that neighbours tell nothing
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide; ++c) light(r, c) = 300.0f + 250.0f * static_cast<float>((r / 2) % 2);
  RawFrame frame = drawn_frame(light, noise, {}, 8);
  NoiseProfile profile = profile_of(noise);
  profile.defects = {kSide, kSide, {}};
  for (const Point& p : places()) {
    profile.defects.places.push_back({p.row, p.col});
    frame.dn(p.row, p.col) = 4000;
    frame.dn(p.row + 4, p.col + 4) = std::numeric_limits<float>::quiet_NaN();
  }
  EXPECT_EQ(denoise_frame(frame, profile, {.profile = "fast"}).kept_pixels, 0);
}

// Too faint to be told from noise one by one; that there are too many pixels so far out is seen.
TEST(KeptPoints, ThatAreDoubtfulStateIt) {
  const std::vector<Point> points = places();
  const PhysicsNoise noise = camera_of("polar-bayer-rggb");
  const Image light = ground_with(22, points);  // 4 deviations
  const Denoised result = filtered(drawn_frame(light, noise, {}, 6), noise);
  double squares = 0, count = 0, unseen = 0;
  for (const Point& p : points) {
    const double off = double{result.dn_above_black(p.row, p.col)} - light(p.row, p.col);
    const double stated = (*result.variance_dn2)(p.row, p.col);
    if (stated > 50) {  // the filter alone states 1 to 3
      squares += off * off / stated;
      count += 1;
    } else {
      unseen += 1;
    }
  }
  EXPECT_GT(count, 0.3 * (count + unseen));
  EXPECT_LT(squares / count, 4);
}

TEST(KeptPoints, AreTheSameForAnyNumberOfThreads) {
  const PhysicsNoise noise = camera_of("bayer-rggb");
  const RawFrame frame = drawn_frame(ground_with(140, places()), noise, {}, 7);
  const int before = thread_count();
  const Denoised some = filtered(frame, noise);
  set_thread_count(before == 1 ? 3 : 1);
  const Denoised other = filtered(frame, noise);
  set_thread_count(before);
  EXPECT_EQ(some.kept_pixels, other.kept_pixels);
  EXPECT_TRUE(std::ranges::equal(some.dn_above_black.values(), other.dn_above_black.values()));
}

}  // namespace
}  // namespace malus
