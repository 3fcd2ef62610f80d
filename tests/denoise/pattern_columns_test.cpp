// Truth: frames of a drawn sensor, and maps with the sampling error of its dark frames.
#include "malus/base/random.h"
#include "malus/denoise/internal/pattern_removal.h"
#include "malus/noise/model.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kHeight = 128, kWidth = 768, kDarkFrames = 16;
constexpr double kReadDn = 2, kColumnNoiseDn = 0.6, kPixelsDn = 2, kShadingDn = 3;

double shading(int col) { return std::sin(col / 40.0); }

double wavy_light(int r, int c) { return 300 + 200 * std::sin(c / 19.0) * std::cos(r / 13.0); }

// A mean of frames: its columns have noise of their own.
Image mean_of(int frames, const Image& fixed, bool lit, std::uint32_t stream) {
  RandomSequence random(41, stream, Draw::kOther);
  std::vector<double> columns;
  for (int c = 0; c < kWidth; ++c)
    columns.push_back(kColumnNoiseDn / std::sqrt(frames) * random.normal());
  Image dn(kHeight, kWidth);
  for (int r = 0; r < kHeight; ++r)
    for (int c = 0; c < kWidth; ++c) {
      const double light = lit ? wavy_light(r, c) : 0,
                   noise = std::sqrt((kReadDn * kReadDn + 0.5 * light) / frames) * random.normal();
      dn(r, c) =
          static_cast<float>(light + fixed(r, c) + columns[static_cast<std::size_t>(c)] + noise);
    }
  return dn;
}

Image dark_signal(std::uint32_t stream) {
  RandomSequence random(42, stream, Draw::kOther);
  Image fixed(kHeight, kWidth);
  for (int r = 0; r < kHeight; ++r)
    for (int c = 0; c < kWidth; ++c)
      fixed(r, c) = static_cast<float>(kPixelsDn * random.normal() + kShadingDn * shading(c));
  return fixed;
}

NoiseProfile profile_of_dark_frames(const Image& fixed, int frames) {
  NoiseModel model;
  model.layout = SensorLayout::named("polar-mono");
  PhysicsCalibration p;
  p.bias_frames = kDarkFrames;
  p.dsnu_dn.assign(4, std::hypot(kPixelsDn, kShadingDn / std::sqrt(2.0)));
  p.sigma_column.mean.assign(4, kColumnNoiseDn);
  p.dark_shading_dn = mean_of(kDarkFrames, fixed, false, 100);
  model.physics.push_back(p);
  NoiseProfile profile;
  profile.layout = model.layout;
  profile.channels.assign(4, ChannelProfile{.variance = VarianceCurve::affine(
                                                0.5 / frames, kReadDn * kReadDn / frames)});
  profile.pattern = fixed_pattern_at(model, {});
  return profile;
}

// Of columns that differ by hardly more than their map's error: a frame seemed to hold 0.5 of them,
// and as much of the shading was taken out, or nothing.
TEST(PatternColumns, ShadingAlongTheRowsGoesWhole) {
  const std::vector<float> never_saturated(4, 1e6f);
  for (std::uint32_t k = 0; k < 2; ++k)
    for (const int frames : {1, 8}) {
      const Image fixed = dark_signal(k);
      const NoiseProfile profile = profile_of_dark_frames(fixed, frames);
      ASSERT_FALSE(profile.pattern->dark_columns_dn.empty());
      for (const bool held : {true, false}) {
        Image dn = mean_of(frames, held ? fixed : Image(kHeight, kWidth), true,
                           10 * k + static_cast<std::uint32_t>(frames));
        const Image raw = dn;
        const MeasuredPattern shares =
            measure_pattern(dn, profile.layout, profile, never_saturated);
        remove_pattern(dn, profile.layout, *profile.pattern, shares,
                       SaturatedPixels(dn, profile.layout, never_saturated));
        if (!held) {
          EXPECT_EQ(dn, raw);
          continue;
        }
        double product = 0, square = 0;
        for (int r = 0; r < kHeight; ++r)
          for (int c = 0; c < kWidth; ++c) {
            product += (dn(r, c) - wavy_light(r, c)) * shading(c);
            square += std::pow(shading(c), 2);
          }
        // Column noise leaves ± 0.03 DN of the shading's shape in one frame, pixels' share ± 0.02.
        EXPECT_NEAR(product / square, 0, 0.15) << frames << " " << shares.dark.columns.value;
      }
    }
}

// The columns' share is their own where it contradicts the pixels'; else it lies between theirs
// and 1.
TEST(PatternColumns, ShareLiesBetweenOneAndThatOfThePixels) {
  PatternShares shares{{.most = 10, .grows = true}, {.most = 10, .grows = true}};
  const auto taken = [&](double pixels, double pixels_error, double columns, double columns_error) {
    shares.pixels.value = pixels, shares.pixels.stderr_value = pixels_error;
    shares.columns.value = columns, shares.columns.stderr_value = columns_error;
    return shares.columns_taken();
  };
  EXPECT_EQ(taken(1, 0.01, 0.8, 0.1), 1);
  EXPECT_EQ(taken(1, 0.01, 0.2, 0.3), 1);  // not told
  EXPECT_EQ(taken(0.6, 0.1, 0.95, 0.1), 0.95);
  EXPECT_EQ(taken(1.4, 0.01, 1.2, 0.1), 1.2);  // a longer exposure
  EXPECT_EQ(taken(1.4, 0.01, 0.8, 0.16), 1);
  EXPECT_EQ(taken(3, 0.01, 1, 0.1), 1);
  EXPECT_EQ(taken(1, 0.01, 0.05, 0.1), 0);  // contradicts, and is none
  EXPECT_EQ(taken(0.02, 0.01, 1, 0.1), 1);  // no pattern of pixels
}

// Nor is a share of the pixels that is not told from 1, because shading goes with it that is many
// times what they differ by.
TEST(PatternColumns, ThePixelsShareIsOneUnlessTheFrameTellsAnother) {
  PatternShares shares{{.most = 10, .grows = true}, {}};
  const auto taken = [&](double value, double error) {
    shares.pixels.value = value;
    shares.pixels.stderr_value = error;
    return shares.pixels_taken();
  };
  EXPECT_EQ(taken(0.9, 0.06), 1);
  EXPECT_EQ(taken(0.9, 0.04), 0.9);
  EXPECT_EQ(taken(1.3, 0.1), 1.3);
  EXPECT_EQ(taken(0.5, 0.2), 0);
}

}  // namespace
}  // namespace malus
