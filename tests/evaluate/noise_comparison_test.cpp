#include "malus/evaluate/noise_comparison.h"

#include "malus/base/parallel.h"
#include "malus/base/random.h"
#include "malus/evaluate/noise_cautions.h"
#include "malus/evaluate/noise_structure.h"

#include <cmath>
#include <limits>

#include "noise_frames.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::frames_of;
using testing::kCols;
using testing::kRows;
using testing::Noise;
using testing::ramp;

// A ramp of 0 to 1270 DN in every frame, of which uniform noise knows nothing; and none.
TEST(CompareNoise, WhatFramesHaveInCommonIsTheirCorrelation) {
  const Noise noise{.sd = 200};
  const auto result =
      compare_noise(frames_of(ramp(), noise, 12, 1), frames_of(ramp(true), noise, 12, 2),
                    std::nullopt, SensorLayout(), {});
  const double ramp_variance = 100.0 * (kCols * kCols - 1) / 12;  // of 10 c, c = 0 ... kCols - 1
  EXPECT_NEAR(result.reference.between_frames, ramp_variance / (ramp_variance + 200.0 * 200), 0.01);
  EXPECT_NEAR(result.test.between_frames, 0, 4 / std::sqrt(11.0 * kRows * kCols));
  const auto one = compare_noise(frames_of(ramp(), noise, 1, 1), frames_of(ramp(), noise, 1, 2),
                                 std::nullopt, SensorLayout(), {});
  EXPECT_EQ(one.reference.between_frames, 0);
}

// The clean scene of frames that were taken at a tenth of its light: nearly all of it was noise,
// and a fixed pattern was suspected. A scene that is mostly noise tells no light.
TEST(CompareNoise, ACleanSceneOfAnotherLightIsTold) {
  const Noise noise{.sd = 5, .mean = 3};
  const Image clean = ramp();
  Image tenth = clean, tenfold = clean;
  for (float& v : tenth.values()) v *= 0.1f;
  for (float& v : tenfold.values()) v *= 10.0f;
  const auto cautions = [&](const Image& scene_of_test, const Image& stated, int frames) {
    const auto result =
        compare_noise(frames_of(clean, noise, frames, 1),
                      frames_of(scene_of_test, noise, frames, 2), stated, SensorLayout(), {});
    std::string all;
    for (const std::string& line : cautions_of(result, {})) all += line + "\n";
    return all;
  };
  EXPECT_EQ(cautions(clean, clean, 1), "");
  const std::string both = cautions(clean, tenfold, 2);
  EXPECT_NE(both.find("the reference shows 0.1 times the light of clean"), std::string::npos);
  EXPECT_NE(both.find("the tests show 0.1 times"), std::string::npos);
  EXPECT_EQ(both.find("alike"), std::string::npos);
  const std::string one = cautions(tenth, clean, 2);
  EXPECT_EQ(one.find("the reference"), std::string::npos);
  EXPECT_NE(one.find("the tests show 0.1 times"), std::string::npos);
  EXPECT_NE(cautions(tenth, tenth, 1).find("the reference shows 10 times"), std::string::npos);
  const Image dark = ramp(true), noisy_scene = frames_of(dark, noise, 1, 3).load(0);
  EXPECT_FALSE(light_over_clean(frames_of(dark, noise, 1, 4).load(0), noisy_scene, SensorLayout()));
}

// Small planes: the lines' means hold a quarter of 8 x 8 pixels' own variance, which is not theirs.
TEST(NoiseStructure, IndependentPixelsOfASmallPlaneMakeNoLines) {
  constexpr int kSide = 8, kFrames = 4000;
  for (const double sd_row : {0.0, 1.5}) {
    StructureSums sums((SensorLayout()));
    for (std::uint32_t k = 0; k < kFrames; ++k) {
      RandomSequence pixels(7, k, Draw::kPixel), rows(7, k, Draw::kRow);
      Image noise(kSide, kSide);
      for (int r = 0; r < kSide; ++r) {
        const double row = sd_row * rows.normal();
        for (int c = 0; c < kSide; ++c) noise(r, c) = static_cast<float>(row + 5 * pixels.normal());
      }
      sums.add(noise);
    }
    const NoiseStructure found = sums.result();
    // Four standard errors of the mean variance of 8 lines.
    const auto error = [&](double sd) {
      return 4 * (sd * sd + 25.0 / kSide) * std::sqrt(2.0 / ((kSide - 1) * kFrames));
    };
    EXPECT_NEAR(std::pow(found.row_sd_dn.at(0), 2), sd_row * sd_row, error(sd_row));
    EXPECT_NEAR(std::pow(found.column_sd_dn.at(0), 2), 0, error(0)) << sd_row;
  }
}

TEST(NoiseStructure, AChannelWithoutPixelsLeavesTheOthersAsTheyAre) {
  const SensorLayout layout = SensorLayout::named("polar-mono");
  StructureSums whole(layout), holed(layout);
  for (std::uint32_t k = 0; k < 2; ++k) {
    RandomSequence random(11, k, Draw::kPixel);
    Image noise(64, 64);
    for (float& v : noise.values()) v = 5 * static_cast<float>(random.normal());
    for (int r = 0; r < 64; r += 2)
      for (int c = 0; c < 64; c += 2) noise(r, c) = std::nanf("");
    holed.add(noise);
    for (int r = 0; r < 64; r += 2)
      for (int c = 0; c < 64; c += 2) noise(r, c) = 0;
    whole.add(noise);
  }
  const NoiseStructure found = holed.result(), even = whole.result();
  EXPECT_TRUE(std::isnan(found.mean_dn[0]) && std::isnan(found.sd_dn[0]) &&
              std::isnan(found.row_sd_dn[0]) && std::isnan(found.column_sd_dn[0]));
  for (const std::size_t k : {1, 2, 3}) EXPECT_EQ(found.sd_dn[k], even.sd_dn[k]);
  // Half of the rows have 64 pixels, half of them 32. Three standard errors of 64 frequencies.
  double power = 0;
  for (const double v : found.row_power_dn2) power += v / kRowBands;
  EXPECT_NEAR(power, 0.5 * (25.0 / 64 + 25.0 / 32), 0.25);
  EXPECT_NEAR(found.along_row[0], 0, 4 / std::sqrt(2.0 * 32 * 63));
  EXPECT_NEAR(found.between_frames, 0, 4 / std::sqrt(3.0 * 32 * 32));
}

// Half of the columns, and a tenth of the others: what is left tells what all would. Every frame
// has the same pattern besides.
TEST(CompareNoise, PixelsThatAreNotFiniteAreLeftOut) {
  RandomSequence random(12, 0, Draw::kOther);
  Image pattern(kRows, kCols);
  for (float& v : pattern.values()) v = static_cast<float>(4 * random.normal());
  const NoiseFrames sound = frames_of(pattern, {.sd = 4, .sd_row = 3}, 40, 3);
  const NoiseFrames holed{40, [&](int k) {
                            Image frame = sound.load(k);
                            RandomSequence holes(13, static_cast<std::uint32_t>(k), Draw::kOther);
                            for (int r = 0; r < kRows; ++r)
                              for (int c = 0; c < kCols; ++c)
                                if (holes.uniform() < 0.1 || c < kCols / 2)
                                  frame(r, c) = std::nanf("");
                            return frame;
                          }};
  const NoiseStructure found =
      compare_noise(sound, holed, std::nullopt, SensorLayout::named("mono"), {}).test;
  EXPECT_NEAR(found.row_sd_dn[0], 3, 0.15);  // 96 rows x 40 frames: 4 standard errors are 0.14
  EXPECT_NEAR(found.column_sd_dn[0], 0, 0.6);
  for (const double correlation : found.along_row) EXPECT_NEAR(correlation, 9.0 / 41, 0.02);
  EXPECT_NEAR(found.along_column[0], 0, 0.02);
  EXPECT_NEAR(found.between_frames, 16.0 / 41, 0.02);
  double power = 0;
  for (const double v : found.row_power_dn2) power += v / kRowBands;
  EXPECT_NEAR(power, 9 + 32 / (0.9 * kCols / 2), 1);
}

TEST(CompareNoise, TheSameNoiseIsAtTheSamplingFloor) {
  const Image clean = ramp();
  const Noise noise{.sd = 3, .slope = 0.5};
  const auto result = compare_noise(frames_of(clean, noise, 6, 1), frames_of(clean, noise, 6, 2),
                                    clean, SensorLayout::named("polar-mono"), {});
  EXPECT_EQ(result.levels.size(), 16u);
  EXPECT_LT(result.pooled.sqrt_jsd, 1.5 * result.pooled.sqrt_jsd_floor);
  for (const auto& level : result.levels)
    EXPECT_LT(level.sqrt_jsd, 1.5 * level.sqrt_jsd_floor) << level.signal_dn;
  EXPECT_EQ(result.pooled.reference_samples, 6 * kRows * kCols);
}

// Pooled over levels the two noises have nearly one distribution; level by level they differ.
TEST(CompareNoise, LevelsSeeWhatPoolingHides) {
  const Image clean = ramp();
  const Noise shot{.sd = 2, .slope = 0.4}, flat{.sd = std::sqrt(4 + 0.4 * 635)};
  const auto result = compare_noise(frames_of(clean, shot, 8, 1), frames_of(clean, flat, 8, 2),
                                    clean, SensorLayout::named("mono"), {});
  EXPECT_GT(result.levels.front().sqrt_jsd, 3 * result.pooled.sqrt_jsd);
  EXPECT_GT(result.levels.back().sqrt_jsd, result.levels[7].sqrt_jsd);
  EXPECT_LT(result.levels.front().signal_dn, result.levels.back().signal_dn);
}

// Two Gaussians of the widths 4 and 5: D(Q||P) = ln(4/5) + 25/32 - 1/2.
TEST(CompareNoise, DivergenceOfGaussiansIsTheClosedForm) {
  const Image dark = ramp(true);
  NoiseComparisonSettings settings;
  settings.bins = 256;
  const auto result =
      compare_noise(frames_of(dark, {.sd = 4}, 40, 1), frames_of(dark, {.sd = 5}, 40, 2),
                    std::nullopt, SensorLayout::named("mono"), settings);
  EXPECT_TRUE(result.levels.empty()) << "a uniform scene has no levels";
  EXPECT_NEAR(result.pooled.kld_nats, std::log(0.8) + 25.0 / 32 - 0.5, 0.003);
}

// White rows have the variance of a row's mean in every band; a first-order autoregressive series
// has the spectrum (1 - a²) / |1 - a exp(-iw)|². Six frequencies of 96 rows a band and 60 frames: 5
// % standard error; four of them, and the bands' own curvature.
TEST(CompareNoise, RowPowerTellsDriftFromWhiteRows) {
  const Image dark = ramp(true);
  const auto result =
      compare_noise(frames_of(dark, {.sd = 2, .sd_row = 0.5}, 60, 1),
                    frames_of(dark, {.sd = 2, .sd_row = 0.5, .row_decay = 0.6}, 60, 2),
                    std::nullopt, SensorLayout::named("mono"), {});
  ASSERT_EQ(result.reference.row_power_dn2.size(), static_cast<std::size_t>(kRowBands));
  const double pixels = 4.0 / kCols;
  for (int band = 0; band < kRowBands; ++band) {
    double expected = 0;
    for (int j = 6 * band + 1; j <= 6 * band + 6; ++j) {
      const double w = 2 * M_PI * j / kRows;
      expected += 0.25 * (1 - 0.36) / (1 - 1.2 * std::cos(w) + 0.36) / 6;
    }
    const auto i = static_cast<std::size_t>(band);
    EXPECT_NEAR(result.reference.row_power_dn2[i], 0.25 + pixels, 0.2 * (0.25 + pixels));
    EXPECT_NEAR(result.test.row_power_dn2[i], expected + pixels, 0.25 * (expected + pixels));
  }
}

// Equal distributions of single pixels, one with its variance in the rows.
TEST(CompareNoise, RowNoiseIsSeenInTheStructure) {
  const Image dark = ramp(true);
  const auto layout = SensorLayout::named("polar-bayer-rggb");
  const auto result = compare_noise(frames_of(dark, {.sd = 4, .sd_row = 3, .row_group = 2}, 30, 1),
                                    frames_of(dark, {.sd = 5}, 30, 2), std::nullopt, layout, {});
  EXPECT_LT(result.pooled.sqrt_jsd, 0.02);
  ASSERT_EQ(result.reference.row_sd_dn.size(), 16u);
  double mean_row = 0;
  for (double v : result.reference.row_sd_dn) mean_row += v / 16;
  EXPECT_NEAR(mean_row, 3, 0.15);  // 24 row groups x 30 frames: 2.6 % standard error, 2 sigma
  for (double v : result.test.row_sd_dn) EXPECT_LT(v, 0.5);
  for (int lag = 0; lag < kLags; ++lag) {
    EXPECT_NEAR(result.reference.along_row[static_cast<std::size_t>(lag)], 9.0 / 25, 0.03);
    EXPECT_NEAR(result.test.along_row[static_cast<std::size_t>(lag)], 0, 0.01);
  }
  // Pairs of rows share an offset: every second neighbour below is in the same pair.
  EXPECT_NEAR(result.reference.along_column[0], 0.5 * 9 / 25, 0.03);
  EXPECT_NEAR(result.reference.along_column[1], 0, 0.03);
}

TEST(CompareNoise, ColumnNoiseIsNotMistakenForRowNoise) {
  const Image dark = ramp(true);
  const auto result = compare_noise(frames_of(dark, {.sd = 4, .sd_column = 2}, 20, 1),
                                    frames_of(dark, {.sd = 4}, 20, 2), std::nullopt,
                                    SensorLayout::named("mono"), {});
  EXPECT_NEAR(result.reference.column_sd_dn[0], 2, 0.1);
  EXPECT_LT(result.reference.row_sd_dn[0], 0.2);
}

TEST(CompareNoise, FixedPatternIsRemovedWithTheVarianceKept) {
  Image pattern = ramp(true);
  RandomSequence random(9, 0, Draw::kOther);
  for (float& v : pattern.values()) v = static_cast<float>(10 * random.normal());
  NoiseComparisonSettings settings;
  settings.remove_fixed_pattern = true;
  settings.levels = 1;
  const auto result =
      compare_noise(frames_of(pattern, {.sd = 4}, 5, 1), frames_of(ramp(true), {.sd = 4}, 5, 2),
                    std::nullopt, SensorLayout::named("mono"), settings);
  EXPECT_NEAR(result.reference.sd_dn[0], 4, 0.05);
  EXPECT_NEAR(result.test.sd_dn[0], 4, 0.05);
  EXPECT_LT(result.pooled.sqrt_jsd, 1.5 * result.pooled.sqrt_jsd_floor);
}

TEST(CompareNoise, BadSetsAreRefused) {
  const Image dark = ramp(true);
  const auto layout = SensorLayout::named("mono");
  const NoiseFrames good = frames_of(dark, {}, 1, 1), none{0, {}};
  const NoiseFrames small{1, [](int) { return Image(3, 3); }};
  const NoiseFrames broken{
      1, [](int) { return Image(kRows, kCols, std::numeric_limits<float>::quiet_NaN()); }};
  EXPECT_THROW(compare_noise(good, none, std::nullopt, layout, {}), InputError);
  EXPECT_THROW(compare_noise(good, small, std::nullopt, layout, {}), InputError);
  EXPECT_THROW(compare_noise(good, good, Image(5, 5), layout, {}), InputError);
  EXPECT_THROW(compare_noise(good, broken, std::nullopt, layout, {}), InputError);
  EXPECT_THROW(compare_noise(good, good, std::nullopt, layout, {.bins = 0}), InputError);
  EXPECT_THROW(compare_noise(good, good, std::nullopt, layout, {.levels = 0}), InputError);
  NoiseComparisonSettings settings;
  const NoiseFrames mixed{2, [](int k) { return k == 0 ? Image(kRows, kCols) : Image(3, 3); }};
  EXPECT_THROW(compare_noise(mixed, mixed, std::nullopt, layout, settings), InputError);
  settings.remove_fixed_pattern = true;
  EXPECT_THROW(compare_noise(mixed, mixed, std::nullopt, layout, settings), InputError);
  EXPECT_THROW(compare_noise(good, good, std::nullopt, layout, settings), InputError);
  const NoiseFrames two = frames_of(dark, {}, 2, 1);
  EXPECT_THROW(compare_noise(two, two, Image(5, 5), layout, settings), InputError);
}

TEST(CompareNoise, TheSameForAnyNumberOfThreads) {
  const Image dark = ramp(true);
  const auto run = [&] {
    return compare_noise(frames_of(dark, {.sd = 4}, 3, 1), frames_of(dark, {.sd = 4}, 3, 2),
                         std::nullopt, SensorLayout::named("polar-mono"), {});
  };
  set_thread_count(1);
  const auto one = run();
  set_thread_count(3);
  const auto three = run();
  set_thread_count(0);
  EXPECT_EQ(one.pooled.jsd_bits, three.pooled.jsd_bits);
  EXPECT_EQ(one.reference.along_row, three.reference.along_row);
}

// Scenes of other light and size, the noise of which is the same on both sides but of the last.
TEST(CompareScenes, AllAreInOneHistogramWhoseFloorFallsWithThem) {
  const auto distance = [](int scenes, double last_sd) {
    return *compare_scenes(
        scenes,
        [=](int k) {
          NoiseOfScene noise{Image(64, 40 + k), Image(64, 40 + k)};
          std::uint32_t side = 0;
          for (Image* image : {&noise.reference, &noise.test}) {
            RandomSequence random(7, static_cast<std::uint32_t>(k), Draw::kOther, side++);
            const double sd = 3.0 + k % 3;
            for (float& v : image->values())
              v = static_cast<float>((image == &noise.test && k + 1 == scenes ? last_sd : 1) * sd *
                                     random.normal());
          }
          noise.test(0, 0) = std::numeric_limits<float>::quiet_NaN();
          return noise;
        },
        128);
  };
  const NoiseDistance one = distance(1, 1), twelve = distance(12, 1), other = distance(12, 3);
  EXPECT_EQ(one.reference_samples, 64 * 40);
  EXPECT_EQ(one.test_samples, 64 * 40 - 1);
  EXPECT_LT(one.sqrt_jsd, 1.5 * one.sqrt_jsd_floor);
  EXPECT_LT(twelve.sqrt_jsd, 1.5 * twelve.sqrt_jsd_floor);
  EXPECT_NEAR(twelve.sqrt_jsd_floor / one.sqrt_jsd_floor, std::sqrt(1.0 / 12), 0.06);
  EXPECT_GT(other.sqrt_jsd, 3 * other.sqrt_jsd_floor);
  EXPECT_FALSE(compare_scenes(0, {}, 128).decided());
}

}  // namespace
}  // namespace malus
