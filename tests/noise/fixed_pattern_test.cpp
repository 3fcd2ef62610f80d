// Truth: maps of a drawn pattern with drawn sampling error.
#include "malus/noise/fixed_pattern.h"

#include "malus/base/random.h"
#include "malus/noise/model.h"
#include "malus/noise/profile.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kRows = 200, kCols = 240, kWeakColumn = 60;
constexpr double kPatternSd = 0.006, kErrorSd = 0.004;

// The map is as far from the truth as a Wiener filter leaves it, and so is a column of four fifths
// of the response, which that filter alone would draw a third of the way to 1.
TEST(FixedPatternAt, SamplingErrorIsTakenOutOfAMapAndOutliersStay) {
  NoiseModel model;
  model.layout = SensorLayout::named("polar-mono");
  PhysicsCalibration p;
  p.prnu.assign(4, kPatternSd);
  p.prnu_map = Image(kRows, kCols);
  Image truth(kRows, kCols);
  RandomSequence random(21, 0, Draw::kOther);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) {
      truth(r, c) = static_cast<float>(c == kWeakColumn ? 0.8 : 1 + kPatternSd * random.normal());
      p.prnu_map(r, c) = static_cast<float>(truth(r, c) + kErrorSd * random.normal());
    }
  model.physics.push_back(p);
  const auto pattern = fixed_pattern_at(model, {});
  ASSERT_TRUE(pattern);
  EXPECT_TRUE(pattern->dark_dn.empty());
  double square = 0, product = 0, size = 0, column = 0;
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) {
      const double off = pattern->response(r, c) + pattern->response_columns(r % 2, c) - 1;
      if (c == kWeakColumn) {
        column += off / kRows;
        continue;
      }
      square += std::pow(off + 1 - truth(r, c), 2);
      product += off * (truth(r, c) - 1);
      size += off * off;
    }
  const double wiener = std::pow(std::hypot(1 / kPatternSd, 1 / kErrorSd), -2);
  EXPECT_NEAR(square / (kRows * (kCols - 1)) / wiener, 1, 0.03);  // 47800 pixels: ± 0.0065
  EXPECT_NEAR(product / size, 1, 0.02);  // how much of the map a frame shows
  EXPECT_NEAR(column, -0.2, 0.003);
  EXPECT_NEAR(pattern->response_kept, wiener / (kErrorSd * kErrorSd), 0.02);
  EXPECT_NEAR(pattern->response_columns_kept, 1, 0.01);  // the weak one's, nearly all
  model.physics[0].prnu.clear();                         // of a model that does not know it
  EXPECT_EQ(fixed_pattern_at(model, {})->response, p.prnu_map);
}

// A glow in a corner, 30 DN, many times as wide as the pixels differ: of their differences, most of
// which are error, frames hold what the map says. They held a seventh of it when the glow's
// variance passed for that of the pixels. The glow stays as it is.
TEST(FixedPatternAt, AGlowHidesNoErrorOfThePixels) {
  constexpr double kPixels = 0.3, kError = 0.75, kGlow = 30;
  constexpr int kFrames = 16;
  const auto glow = [](int r, int c) {
    return kGlow * std::exp(-std::hypot(r - kRows, c - kCols) / 120.0);
  };
  for (const char* layout : {"mono", "polar-mono"})
    for (const double height : {1.0, 0.0}) {
      NoiseModel model;
      model.layout = SensorLayout::named(layout);
      PhysicsCalibration p;
      const auto channels = static_cast<std::size_t>(model.layout.channels());
      double mean = 0, square_mean = 0;
      for (int r = 0; r < kRows; ++r)
        for (int c = 0; c < kCols; ++c) {
          mean += height * glow(r, c) / (kRows * kCols);
          square_mean += std::pow(height * glow(r, c), 2) / (kRows * kCols);
        }
      p.bias_frames = kFrames;
      p.dsnu_dn.assign(channels, std::sqrt(square_mean - mean * mean + kPixels * kPixels));
      p.temporal_sd_dark_dn.assign(channels, kError * std::sqrt(kFrames));
      p.sigma_row.mean.assign(channels, 0.0);
      p.dark_shading_dn = Image(kRows, kCols);
      Image truth(kRows, kCols);
      RandomSequence random(24, 0, Draw::kOther);
      for (int r = 0; r < kRows; ++r)
        for (int c = 0; c < kCols; ++c) {
          truth(r, c) = static_cast<float>(height * glow(r, c) - mean + kPixels * random.normal());
          p.dark_shading_dn(r, c) = static_cast<float>(truth(r, c) + kError * random.normal());
        }
      model.physics.push_back(p);
      const auto pattern = fixed_pattern_at(model, {});
      const int period = model.layout.cols();
      const auto map = [&](int r, int c) {
        return pattern->dark_dn(r, c) +
               (pattern->dark_columns_dn.empty() ? 0 : pattern->dark_columns_dn(r % period, c));
      };
      double product = 0, square = 0, off = 0;
      for (int r = 0; r < kRows; ++r)
        for (int c = period; c + period < kCols; ++c) {
          const auto stands_out = [&](const auto& of) {
            return of(r, c) - 0.5 * (of(r, c - period) + of(r, c + period));
          };
          product += stands_out(map) * stands_out(truth);
          square += stands_out(map) * stands_out(map);
          if (r > kRows - 40 && c > kCols - 40) off += (map(r, c) - truth(r, c)) / (39 * 38);
        }
      // The share's error, of 47000 pixels and a map of a deviation of 0.1 DN: 0.03.
      EXPECT_NEAR(product / square, 1, 0.12) << layout << height;
      EXPECT_NEAR(off, 0, 0.3) << layout;
      const double smooth = pattern->dark_shares.smooth + pattern->dark_shares.columns;
      EXPECT_NEAR(smooth, height > 0 ? 0.99 : 0, 0.02) << layout;
    }
}

// Maps are of the nearest gain that has one.
TEST(FixedPatternAt, IsOfTheNearestGain) {
  NoiseModel model;
  model.layout = SensorLayout::named("mono");
  for (const double gain_db : {0.0, 12.0, 24.0}) {
    PhysicsCalibration p;
    p.gain.gain_db = gain_db;
    p.dark_shading_dn = Image(4, 4);
    for (float& value : p.dark_shading_dn.values()) value = static_cast<float>(1 + gain_db / 12);
    model.physics.push_back(p);
  }
  model.physics[0].prnu_map = Image(4, 4);
  for (float& value : model.physics[0].prnu_map.values()) value = 1.5F;
  const auto at = [&](double gain_db) {
    GainSetting gain;
    gain.gain_db = gain_db;
    return fixed_pattern_at(model, gain);
  };
  for (const auto& [gain_db, expected] :
       {std::pair{0.0, 1.0F}, {5.0, 1.0F}, {7.0, 2.0F}, {13.0, 2.0F}, {19.0, 3.0F}, {40.0, 3.0F}}) {
    EXPECT_EQ(at(gain_db)->dark_dn(1, 2), expected) << gain_db;
    EXPECT_EQ(at(gain_db)->response(1, 2), 1.5F) << gain_db;
  }
}

// Dark columns of a third of the pixels' sampling error, told by 100 pixels each: they are kept,
// while the pixels' pattern, a tenth of that error, is not. Column noise of as much that the frames
// left in the map is no pattern, and a map without columns has none apart.
TEST(FixedPatternAt, ColumnsAreDrawnByTheErrorOfTheirMeans) {
  constexpr double kError = 0.6, kPixels = 0.06, kColumns = 0.2;
  for (const double columns_sd : {0.0, kColumns})
    for (const double noise_sd : {0.0, kColumns}) {
      NoiseModel model;
      model.layout = SensorLayout::named("polar-mono");
      PhysicsCalibration p;
      p.bias_frames = 25;
      p.dsnu_dn.assign(4, std::hypot(kPixels, columns_sd));
      p.sigma_column.mean.assign(4, 5 * noise_sd);
      p.dark_shading_dn = Image(kRows, kCols);
      RandomSequence random(22, 0, Draw::kOther);
      std::vector<double> truth(kCols), noise(kCols);
      for (int c = 0; c < kCols; ++c) {
        truth[static_cast<std::size_t>(c)] = columns_sd * random.normal();
        noise[static_cast<std::size_t>(c)] = noise_sd * random.normal();
      }
      for (int r = 0; r < kRows; ++r)
        for (int c = 0; c < kCols; ++c)
          p.dark_shading_dn(r, c) = static_cast<float>(
              truth[static_cast<std::size_t>(c)] + noise[static_cast<std::size_t>(c)] +
              std::hypot(kPixels, kError) * random.normal());
      model.physics.push_back(p);
      const auto pattern = fixed_pattern_at(model, {});
      EXPECT_EQ(pattern->dark_columns_dn.empty(), columns_sd == 0) << noise_sd;
      double pixels = 0, product = 0, square = 0;
      for (int r = 0; r < kRows; ++r)
        for (int c = 0; c < kCols; ++c) {
          pixels += std::pow(pattern->dark_dn(r, c), 2) / (kRows * kCols);
          if (columns_sd == 0) continue;
          product += pattern->dark_columns_dn(r % 2, c) * truth[static_cast<std::size_t>(c)];
          square += std::pow(truth[static_cast<std::size_t>(c)], 2);
        }
      EXPECT_LT(pixels, 0.05 * 0.05);
      // Of equal parts of pattern and error half is kept, ± its own error of 240 columns.
      if (columns_sd == 0) continue;
      EXPECT_NEAR(product / square, noise_sd > 0 ? 0.5 : 0.92, 0.1);
      EXPECT_NEAR(pattern->dark_columns_kept, noise_sd > 0 ? 0.5 : 0.92, 0.1);
    }
}

// Shading many times as wide as the columns differ: of their differences, half of which are error,
// frames hold what the map says. They held half of it when the shading's variance passed for that
// of the columns. The shading stays as it is.
TEST(FixedPatternAt, ShadingAlongTheRowsHidesNoErrorOfTheColumns) {
  constexpr int kWide = 1600;
  constexpr double kPixels = 0.3, kColumns = 0.2, kShading = 3;
  NoiseModel model;
  model.layout = SensorLayout::named("polar-mono");
  PhysicsCalibration p;
  p.bias_frames = 25;
  p.dsnu_dn.assign(4, std::hypot(kPixels, kShading / std::sqrt(2.0)));
  p.sigma_column.mean.assign(4, 5 * kColumns);
  p.dark_shading_dn = Image(kRows, kWide);
  RandomSequence random(23, 0, Draw::kOther);
  std::vector<double> truth;
  for (int c = 0; c < kWide; ++c) {
    const double smooth = kShading * std::sin(c / 40.0), error = kColumns * random.normal();
    truth.push_back(kColumns * random.normal());
    for (int r = 0; r < kRows; ++r)
      p.dark_shading_dn(r, c) =
          static_cast<float>(smooth + truth.back() + error + kPixels * random.normal());
  }
  model.physics.push_back(p);
  const auto pattern = fixed_pattern_at(model, {});
  ASSERT_FALSE(pattern->dark_columns_dn.empty());
  double product = 0, square = 0, smooth = 0, of_sine = 0;
  for (int c = 2; c + 2 < kWide; ++c) {
    const auto stands_out = [&](const auto& at) { return at(c) - 0.5 * (at(c - 2) + at(c + 2)); };
    const auto map = [&](int col) {
      return 0.5 * (pattern->dark_columns_dn(0, col) + pattern->dark_columns_dn(1, col));
    };
    const double of_map = stands_out(map);
    product += of_map * stands_out([&](int col) { return truth[static_cast<std::size_t>(col)]; });
    square += of_map * of_map;
    smooth += map(c) * std::sin(c / 40.0);
    of_sine += std::pow(std::sin(c / 40.0), 2);
  }
  EXPECT_NEAR(product / square, 1, 0.2);          // ± 0.05, most of it of the variance
  EXPECT_NEAR(smooth / of_sine, kShading, 0.05);  // ± 0.01
  EXPECT_NEAR(pattern->dark_columns_kept, 0.5, 0.07);
}

TEST(PatternDeviationsAt, AreThoseOfTheNearestGainInTheFramesDn) {
  NoiseModel model;
  model.layout = SensorLayout::named("mono");
  for (const double gain_db : {0.0, 12.0}) {
    PhysicsCalibration p;
    p.gain.gain_db = gain_db;
    p.K.mean = {gain_db > 0 ? 2.0 : 0.5};
    p.dsnu_dn = {gain_db > 0 ? 3.0 : 1.0};
    model.physics.push_back(p);
  }
  model.physics[0].prnu = {0.01};
  NoiseProfile profile;
  profile.layout = model.layout;
  profile.channels = {{.variance = VarianceCurve::affine(1, 4), .gain_dn_per_e = 1.0}};
  const auto at = [&](double gain_db) {
    return pattern_deviations_at(model, {gain_db, {}}, profile).at(0);
  };
  EXPECT_DOUBLE_EQ(at(5).dsnu_dn, 2);  // twice the DN per electron of 0 dB
  EXPECT_DOUBLE_EQ(at(7).dsnu_dn, 1.5);
  EXPECT_DOUBLE_EQ(at(7).prnu, 0.01);  // of the gain that has it
  model.physics[0].prnu = {std::nan("")};
  EXPECT_EQ(at(7).prnu, 0);
  add_pattern_noise(profile, {{0.01, 3}});
  EXPECT_DOUBLE_EQ(profile.channels[0].variance(200), 200 + 4 + 4 + 9);
}

}  // namespace
}  // namespace malus
