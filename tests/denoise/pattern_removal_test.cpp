// Truth: frames drawn from known scenes, maps and shares.
#include "malus/denoise/internal/pattern_removal.h"

#include "malus/base/random.h"
#include "malus/denoise/denoiser.h"
#include "malus/noise/model.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kRows = 320, kCols = 400;
constexpr double kSlope = 0.4, kFloor = 4;  // variance of the noise: DN, DN²

using Scene = std::function<double(int, int)>;

double smooth_scene(int r, int c) {
  return (300 + 200 * std::sin(r * 0.05) * std::cos(c * 0.04)) * (1 + 0.2 * ((r + c) % 2 ? 1 : -1));
}

// Vertical stripes, as steep as they come, of no period that the maps share.
double striped_scene(int, int c) { return 500 + 300 * std::sin(2.4 * c + 0.002 * c * c); }

Image normal_map(double centre, double sd, std::uint32_t stream, bool columns = false) {
  RandomSequence random(11, stream, Draw::kOther);
  Image map(kRows, kCols);
  for (float& v : map.values()) v = static_cast<float>(centre + sd * random.normal());
  if (columns)
    for (int r = 1; r < kRows; ++r)
      for (int c = 0; c < kCols; ++c) map(r, c) = map(0, c);
  return map;
}

NoiseProfile profile_with(Image dark_dn, Image response) {
  NoiseProfile profile;
  profile.layout = SensorLayout::named("polar-bayer-rggb");
  profile.channels.assign(16, ChannelProfile{.variance = VarianceCurve::affine(kSlope, kFloor)});
  profile.pattern =
      std::make_shared<const FixedPattern>(FixedPattern{std::move(dark_dn), std::move(response)});
  return profile;
}

// The first cell's rows, about the middle.
Image columns_of(const Image& map, float middle) {
  Image columns(4, kCols);
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < kCols; ++c) columns(r, c) = map(r, c) - middle;
  return columns;
}

NoiseProfile profile_with_columns(Image dark_dn, Image dark_columns_dn, Image response_columns) {
  NoiseProfile profile = profile_with({}, {});
  FixedPattern pattern;
  pattern.dark_dn = std::move(dark_dn);
  pattern.dark_columns_dn = std::move(dark_columns_dn);
  pattern.response_columns = std::move(response_columns);
  if (!pattern.response_columns.empty()) pattern.response = Image(kRows, kCols, 1);
  profile.pattern = std::make_shared<const FixedPattern>(std::move(pattern));
  return profile;
}

Image drawn(const Scene& scene, const FixedPattern& maps, double dark, double response,
            std::uint32_t stream) {
  RandomSequence random(5, stream, Draw::kOther);
  Image dn(kRows, kCols);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) {
      double s = scene(r, c);
      if (!maps.response.empty()) s *= 1 + response * (maps.response(r, c) - 1);
      const double noise = std::sqrt(kSlope * std::max(s, 0.0) + kFloor) * random.normal();
      dn(r, c) =
          static_cast<float>(s + noise + (maps.dark_dn.empty() ? 0 : dark * maps.dark_dn(r, c)));
    }
  return dn;
}

const std::vector<float> kNeverSaturated(16, 1e6f);

MeasuredPattern shares_of(const Image& dn, const NoiseProfile& profile) {
  return measure_pattern(dn, profile.layout, profile, kNeverSaturated);
}

// Shares within 4.5 of their standard errors, and these about as large as a regression with known
// weights has them (level of each comparison: 1e-5).
TEST(PatternRemoval, SharesAreThoseThatWereDrawn) {
  const NoiseProfile profile = profile_with(normal_map(0, 3, 1), normal_map(1, 0.02, 2));
  for (const auto& [dark, response] : {std::pair{1.0, 1.0}, {0.0, 1.0}, {1.7, 0.0}, {0.5, 0.6}}) {
    const auto shares =
        shares_of(drawn(smooth_scene, *profile.pattern, dark, response, 3), profile);
    EXPECT_NEAR(shares.dark.pixels.value, dark, 4.5 * shares.dark.pixels.stderr_value);
    EXPECT_NEAR(shares.response.pixels.value, response, 4.5 * shares.response.pixels.stderr_value);
    // sd of a share = sd of the noise / (sd of the map times the root of the pixels), by order of
    // size: overlapping differences and the scene's slopes add some, eight strips tell it roughly.
    const double noise = std::sqrt((kSlope * 300 + kFloor) / (kRows * kCols));
    for (const double ratio : {shares.dark.pixels.stderr_value / (noise / 3),
                               shares.response.pixels.stderr_value / (noise / 6)}) {
      EXPECT_GT(ratio, 0.6);
      EXPECT_LT(ratio, 3.0);
    }
    EXPECT_EQ(shares.dark.pixels.present(), dark > 0);
    EXPECT_EQ(shares.response.pixels.present(), response > 0);
  }
}

// Texture many times as wide as the noise, as in foliage by daylight: neighbours differ by it, and
// few tell the pattern. When weights were as narrow as the noise, five rounds of them found 0.63
// and 0.40 of the response (level of each comparison: 1e-5).
TEST(PatternRemoval, TextureLeavesTheSharesAsTheyAre) {
  for (const double contrast : {0.05, 0.1}) {
    const Image texture = normal_map(1, contrast, 9);
    const auto scene = [&](int r, int c) {
      return 20000 * std::max(double{texture(r, c)}, 0.05) * (r < kRows / 4 ? 0.1 : 1);
    };
    const NoiseProfile profile = profile_with(Image(), normal_map(1, 0.03, 2));
    const auto shares = shares_of(drawn(scene, *profile.pattern, 0, 1, 10), profile);
    EXPECT_TRUE(shares.response.pixels.present());
    EXPECT_NEAR(shares.response.pixels.value, 1, 4.5 * shares.response.pixels.stderr_value);
    EXPECT_LT(shares.response.pixels.stderr_value, 0.1);
    EXPECT_FALSE(
        shares_of(drawn(scene, *profile.pattern, 0, 0, 10), profile).response.pixels.present());
  }
}

TEST(PatternRemoval, OneMapAloneServes) {
  for (const bool has_dark : {true, false}) {
    const NoiseProfile profile = profile_with(has_dark ? normal_map(0, 3, 1) : Image(),
                                              has_dark ? Image() : normal_map(1, 0.02, 2));
    const auto shares = shares_of(drawn(smooth_scene, *profile.pattern, 1, 1, 4), profile);
    EXPECT_EQ(shares.dark.pixels.present(), has_dark);
    EXPECT_EQ(shares.response.pixels.present(), !has_dark);
    const PatternShare& share = has_dark ? shares.dark.pixels : shares.response.pixels;
    EXPECT_NEAR(share.value, 1, 4.5 * share.stderr_value);
  }
}

// Column noise against a scene of vertical stripes: by chance the two agree more than so many
// independent pixels would. None of twenty maps is taken for part of the scene.
TEST(PatternRemoval, StripesAreNoColumnPattern) {
  for (std::uint32_t k = 0; k < 20; ++k) {
    const Image dark = normal_map(0, 2, 100 + k, true),
                response = normal_map(1, 0.01, 200 + k, true);
    for (const bool apart : {false, true}) {
      const NoiseProfile profile =
          apart ? profile_with_columns(normal_map(0, 1, 300 + k), columns_of(dark, 0),
                                       columns_of(response, 1))
                : profile_with(dark, response);
      const auto shares = shares_of(drawn(striped_scene, FixedPattern{}, 0, 0, k), profile);
      EXPECT_EQ(shares.dark.taken(), 0) << apart;
      EXPECT_EQ(shares.response.taken(), 0) << apart;
      EXPECT_EQ(shares.dark.columns_taken(), 0) << apart;
    }
  }
}

// Columns are told from pixels that a longer exposure made three times as dark, and that a frame
// may lack.
TEST(PatternRemoval, ColumnsHaveAShareOfTheirOwn) {
  const Image columns = normal_map(0, 2, 41, true);
  const NoiseProfile profile =
      profile_with_columns(normal_map(0, 3, 1), columns_of(columns, 0), Image());
  for (const auto& [pixels, own] : {std::pair(3, 1), {0, 1}, {1, 0}}) {
    Image dn = drawn(smooth_scene, *profile.pattern, pixels, 0, 42);
    for (int r = 0; r < kRows; ++r)
      for (int c = 0; c < kCols; ++c) dn(r, c) += static_cast<float>(own) * columns(r, c);
    const MeasuredPattern shares = shares_of(dn, profile);
    EXPECT_NEAR(shares.dark.pixels.taken(), pixels, 0.1);
    EXPECT_NEAR(shares.dark.columns_taken(), own, 0.1);
    const double taken = shares.dark.taken();
    EXPECT_NEAR(taken, pixels > 0 ? pixels : own, 0.1);
    remove_pattern(dn, profile.layout, *profile.pattern, shares,
                   SaturatedPixels(dn, profile.layout, kNeverSaturated));
    double squares = 0, noise = 0;
    for (int r = 0; r < kRows; ++r)
      for (int c = 0; c < kCols; ++c) {
        squares += std::pow(dn(r, c) - smooth_scene(r, c), 2);
        noise += kSlope * smooth_scene(r, c) + kFloor;
      }
    EXPECT_NEAR(squares / noise, 1, 0.01);
  }
}

// The glow at a sensor's edge hardly differs between neighbours: no frame tells its columns' share,
// which is that of the pixels then.
TEST(PatternRemoval, ColumnsThatNoFrameTellsGoWithThePixels) {
  Image glow(kRows, kCols);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) glow(r, c) = static_cast<float>(20 * std::exp(-c / 100.0));
  const NoiseProfile profile =
      profile_with_columns(normal_map(0, 3, 1), columns_of(glow, 0), Image());
  for (const double share : {0.0, 1.0}) {
    Image dn = drawn(smooth_scene, *profile.pattern, share, 0, 43);
    for (int r = 0; r < kRows; ++r)
      for (int c = 0; c < kCols; ++c) dn(r, c) += static_cast<float>(share) * glow(r, c);
    const MeasuredPattern shares = shares_of(dn, profile);
    EXPECT_FALSE(shares.dark.columns.present());
    EXPECT_EQ(shares.dark.columns_taken(), shares.dark.pixels_taken());
    EXPECT_NEAR(shares.dark.columns_taken(), share, 0.05);
  }
}

// Every pixel of a test chart lies at a step, and some are undone by whatever share is large
// enough.
TEST(PatternRemoval, AChartOfBarsHoldsNoPattern) {
  const auto bars = [](int, int c) { return c % 12 < 6 ? 12000.0 : 1500.0; };
  for (const double prnu : {0.001, 0.04})
    for (std::uint32_t k = 0; k < 6; ++k) {
      const NoiseProfile profile =
          profile_with(normal_map(0, 0.2, 300 + k), normal_map(1, prnu, 400 + k));
      const auto shares = shares_of(drawn(bars, *profile.pattern, 0, 0, k), profile);
      EXPECT_EQ(shares.dark.pixels.value, 0);
      EXPECT_EQ(shares.response.pixels.value, 0);
    }
}

TEST(PatternRemoval, NoFrameHoldsAMapManyTimes) {
  MeasuredPattern shares;
  EXPECT_FALSE(shares.dark.pixels.present());
  shares.dark.pixels.stderr_value = shares.response.pixels.stderr_value = 0.1;
  shares.dark.pixels.value = 4, shares.response.pixels.value = 1.1;
  EXPECT_TRUE(shares.dark.pixels.present() && shares.response.pixels.present());
  shares.dark.pixels.value = 150, shares.response.pixels.value = 3;
  EXPECT_FALSE(shares.dark.pixels.present() || shares.response.pixels.present());
}

// More than one share of the response is but the noise of a frame that the maps were made of, and
// so is what is kept of more than one of the dark shading.
TEST(PatternRemoval, NoiseThatAFrameSharesWithTheMapsIsNotTakenOutTwice) {
  PatternShare dark{.most = 10, .grows = true, .kept = 0.125}, response{.most = 2, .kept = 0.5};
  dark.stderr_value = response.stderr_value = 0.01;
  for (const auto& [value, taken] : {std::pair(0.8, 0.8), {1.5, 1.0}, {8.2, 1.025}, {40, 5}}) {
    dark.value = value;
    EXPECT_NEAR(dark.taken(), taken, 1e-12);
  }
  for (const auto& [value, taken] : {std::pair(0.8, 0.8), {1.5, 1.0}, {3.0, 1.0}, {4.5, 0.0}}) {
    response.value = value;
    EXPECT_NEAR(response.taken(), taken, 1e-12);
  }
}

// Two frames of a flat, the model's maps made of them, and one of the two: its own noise, half of
// the maps' error, makes the share 1.7, by which the weak column was made too bright.
TEST(PatternRemoval, AWeakColumnOfTheMapsOwnFrameIsRight) {
  constexpr double kPrnu = 0.005, kWeak = 0.9, kLight = 2000;
  constexpr int kColumn = 101;
  Image truth = normal_map(1, kPrnu, 21);
  for (int r = 0; r < kRows; ++r) truth(r, kColumn) *= static_cast<float>(kWeak);
  const FixedPattern flat{Image(), truth};
  const auto even = [](int, int) { return kLight; };
  const Image own = drawn(even, flat, 0, 1, 31), other = drawn(even, flat, 0, 1, 32);
  NoiseModel model;
  model.layout = SensorLayout::named("polar-bayer-rggb");
  PhysicsCalibration p;
  p.prnu.assign(16, kPrnu);
  p.prnu_map = Image(kRows, kCols);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c)
      p.prnu_map(r, c) = static_cast<float>((own(r, c) + other(r, c)) / (2 * kLight));
  model.physics.push_back(std::move(p));
  NoiseProfile profile = profile_with(Image(), Image());
  profile.pattern = fixed_pattern_at(model, {});
  Image dn = own;
  const MeasuredPattern shares = shares_of(dn, profile);
  EXPECT_GT(shares.response.pixels.value, 1.5);
  EXPECT_EQ(shares.response.taken(), 1);
  remove_pattern(dn, profile.layout, *profile.pattern, shares,
                 SaturatedPixels(dn, profile.layout, kNeverSaturated));
  double column = 0, all = 0;
  for (int r = 0; r < kRows; ++r) {
    column += dn(r, kColumn) / kRows;
    for (int c = 0; c < kCols; ++c) all += dn(r, c) / (kRows * kCols);
  }
  // Shot noise of 28 DN: a column's mean is known to 0.0008. It was 4 % too bright.
  EXPECT_NEAR(column / all, 1, 0.005);
}

TEST(PatternRemoval, WhatIsPresentGoesAndSaturatedPixelsStay) {
  const NoiseProfile profile = profile_with(normal_map(0, 30, 1), normal_map(1, 0.1, 2));
  Image dn = drawn(smooth_scene, *profile.pattern, 1, 1, 6);
  dn(100, 100) = 4000;
  const std::vector<float> saturated(16, 3900.0f);
  const auto shares = measure_pattern(dn, profile.layout, profile, saturated);
  const SaturatedPixels at_white(dn, profile.layout, saturated);
  remove_pattern(dn, profile.layout, *profile.pattern, shares, at_white);
  EXPECT_EQ(dn(100, 100), 4000);
  double squares = 0, noise = 0;
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c)
      if (r != 100 || c != 100) {
        squares += std::pow(dn(r, c) - smooth_scene(r, c), 2);
        noise += kSlope * smooth_scene(r, c) + kFloor;
      }
  EXPECT_NEAR(squares / noise, 1, 0.03);  // 1.02: the shares' and a tenth of response's own factor
  Image left = dn;
  remove_pattern(left, profile.layout, *profile.pattern, {}, at_white);
  EXPECT_EQ(left, dn);
}

// Of large frames some rows are passed over. A cell of three rows, of which one is saturated
// everywhere: the others still tell the pattern.
TEST(PatternRemoval, AllRowsOfACellTellThePattern) {
  constexpr int kHigh = 1536, kWide = 1400;  // every third row is enough
  NoiseProfile profile;
  profile.layout = SensorLayout::from_sites({{"R"}, {"G1"}, {"B"}});
  profile.channels.assign(3, ChannelProfile{.variance = VarianceCurve::affine(0.0, 4.0)});
  Image dark(kHigh, kWide), dn(kHigh, kWide, 4000);
  RandomSequence random(17, 0, Draw::kOther);
  for (int r = 0; r < kHigh; ++r)
    for (int c = 0; c < kWide; ++c) {
      dark(r, c) = static_cast<float>(3 * random.normal());
      if (r % 3 != 0) dn(r, c) = static_cast<float>(500 + dark(r, c) + 2 * random.normal());
    }
  profile.pattern = std::make_shared<const FixedPattern>(FixedPattern{std::move(dark), Image()});
  const auto shares = measure_pattern(dn, profile.layout, profile, std::vector<float>(3, 4000.0f));
  EXPECT_TRUE(shares.dark.pixels.present());
  EXPECT_NEAR(shares.dark.pixels.value, 1, 0.02);
}

// Just below white: dividing by their response lifts the pixels over it, but nothing was clipped.
TEST(PatternRemoval, APixelThatIsLiftedOverWhiteIsNotSaturated) {
  const NoiseProfile profile = profile_with(Image(), normal_map(1, 0.02, 2));
  RawFrame frame;
  frame.layout = profile.layout;
  frame.black_dn.assign(16, 0.0);
  frame.white_dn = 700;
  frame.white_known = true;
  frame.source = "test";
  frame.dn = drawn([](int, int) { return 650.0; }, *profile.pattern, 0, 1, 8);
  frame.dn(100, 100) = 700;
  int lifted = 0;
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) {
      float& pixel = frame.dn(r, c);
      if (r != 100 || c != 100) pixel = std::min(pixel, 699.0f);
      lifted += pixel < 700 && pixel / profile.pattern->response(r, c) > 701;
    }
  ASSERT_GT(lifted, 20);
  const Denoised result =
      denoise_frame(frame, profile, {.profile = "fast"}, silent_progress(), true);
  ASSERT_GT(result.response_pattern_share, 0.9);
  EXPECT_EQ(result.saturated_pixels, 1);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c)
      EXPECT_EQ(std::isnan((*result.variance_dn2)(r, c)), r == 100 && c == 100);
  EXPECT_EQ(result.dn_above_black(100, 100), 700);
}

RawFrame frame_of_smooth_scene(const NoiseProfile& profile) {
  RawFrame frame;
  frame.layout = profile.layout;
  frame.black_dn.assign(16, 0.0);
  frame.white_dn = 4095;
  frame.white_known = true;
  frame.source = "test";
  frame.dn = drawn(smooth_scene, *profile.pattern, 1, 1, 7);
  return frame;
}

TEST(PatternRemoval, ADenoisedFrameIsNearerToItsScene) {
  const NoiseProfile profile = profile_with(normal_map(0, 5, 1), normal_map(1, 0.02, 2));
  const RawFrame frame = frame_of_smooth_scene(profile);
  const auto squared_error = [&](const NoiseProfile& known, bool wanted) {
    DenoiseSettings settings{.profile = "fast", .fixed_pattern = wanted};
    const Denoised result = denoise_frame(frame, known, settings);
    EXPECT_EQ(result.dark_pattern_share > 0, known.pattern && wanted &&
                                                 !known.pattern->dark_dn.empty() &&
                                                 known.pattern->dark_dn.rows() == kRows);
    double sum = 0;
    for (int r = 0; r < kRows; ++r)
      for (int c = 0; c < kCols; ++c)
        sum += std::pow(result.dn_above_black(r, c) - smooth_scene(r, c), 2);
    return sum;
  };
  const double with = squared_error(profile, true);
  EXPECT_LT(with, 0.8 * squared_error(profile, false));
  NoiseProfile other = profile;  // maps of another size are of another sensor, or of a whole one
  other.pattern = std::make_shared<const FixedPattern>(FixedPattern{Image(8, 8), Image(8, 8, 1)});
  EXPECT_GT(squared_error(other, true), with);
}

TEST(PatternRemoval, HolesTakeNoPartInTheShares) {
  const NoiseProfile profile = profile_with(normal_map(0, 5, 1), normal_map(1, 0.02, 2));
  RawFrame frame = frame_of_smooth_scene(profile);
  for (int r = 0; r < kRows; ++r)
    for (int c = 120; c < kCols; ++c) frame.dn(r, c) = std::numeric_limits<float>::quiet_NaN();
  const Denoised result = denoise_frame(frame, profile, {.profile = "fast"});
  EXPECT_NEAR(result.dark_pattern_share, 1, 0.05);
  EXPECT_NEAR(result.response_pattern_share, 1, 0.1);
}

}  // namespace
}  // namespace malus
