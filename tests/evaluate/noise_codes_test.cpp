// Frames of a converter's codes beside others, and beside noise that was never rounded.
#include "malus/base/random.h"
#include "malus/evaluate/noise_comparison.h"

#include <cmath>

#include "noise_frames.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::frames_of;
using testing::kCols;
using testing::kRows;
using testing::Noise;
using testing::ramp;

TEST(CompareNoise, WholeNumbersGetWholeNumberBins) {
  const Image dark = ramp(true);
  const Noise noise{.sd = 20, .rounded = true};
  NoiseComparisonSettings settings;
  settings.bins = 100;
  const auto result = compare_noise(frames_of(dark, noise, 3, 1), frames_of(dark, noise, 3, 2),
                                    std::nullopt, SensorLayout::named("mono"), settings);
  EXPECT_EQ(result.pooled.bin_width_dn, std::round(result.pooled.bin_width_dn));
  EXPECT_GE(result.pooled.bin_width_dn, 2);
  EXPECT_LT(result.pooled.sqrt_jsd, 1.5 * result.pooled.sqrt_jsd_floor);
}

// A camera's codes and the same noise before it was rounded: counted in whole steps with edges
// midway between the codes they are equal, however narrow they are.
TEST(CompareNoise, CodesAndUnroundedNoiseAreCompared) {
  const Image dark = ramp(true);
  for (const double sd : {0.6, 3.0}) {
    const NoiseFrames codes = frames_of(dark, {.sd = sd, .rounded = true}, 4, 1),
                      floats = frames_of(dark, {.sd = sd}, 4, 2);
    for (const bool turned : {false, true}) {
      const auto result = compare_noise(turned ? floats : codes, turned ? codes : floats,
                                        std::nullopt, SensorLayout::named("mono"), {});
      EXPECT_LT(result.pooled.sqrt_jsd, 2 * result.pooled.sqrt_jsd_floor) << sd << turned;
    }
  }
}

// Twelve bits in the upper bits of sixteen, of pixels with levels of their own: bins that are no
// whole steps would be a comb over the codes, and frames less their mean have codes of their own in
// every pixel, so that no bins would do.
TEST(CompareNoise, CodesOfAWideStepAndUnroundedNoiseAreCompared) {
  Image pattern(kRows, kCols);
  RandomSequence random(14, 0, Draw::kOther);
  for (float& v : pattern.values()) v = static_cast<float>(3 * random.normal());
  const auto set = [&](double sd, bool rounded, float step_dn, float black_dn, std::uint64_t seed) {
    const NoiseFrames frames = frames_of(pattern, {.sd = sd, .rounded = rounded}, 8, seed);
    return NoiseFrames{8, [=](int k) {
                         Image frame = frames.load(k);
                         for (float& v : frame.values()) v = step_dn * v - black_dn;
                         return frame;
                       }};
  };
  NoiseComparisonSettings settings;
  for (const float step_dn : {1.0f, 16.0f})
    for (const float black_dn : {0.0f, 82.3f})
      for (const bool removed : {false, true}) {
        settings.remove_fixed_pattern = removed;
        const auto named =
            fmt::format("step {}, black {}, pattern removed: {}", step_dn, black_dn, removed);
        const NoiseFrames codes = set(0.6, true, step_dn, black_dn, 1);
        const auto against = [&](double sd) {
          return compare_noise(codes, set(sd, false, step_dn, black_dn, 2), std::nullopt,
                               SensorLayout::named("mono"), settings);
        };
        const auto same = against(0.6);
        EXPECT_LT(same.pooled.sqrt_jsd, 2 * same.pooled.sqrt_jsd_floor) << named;
        EXPECT_EQ(same.test_rounded_dn, step_dn) << named;
        EXPECT_EQ(same.reference_rounded_dn, 0) << named;
        if (removed) {  // beside the pattern's 3 steps it is nothing
          EXPECT_GT(against(0.7).pooled.sqrt_jsd, 3 * same.pooled.sqrt_jsd_floor) << named;
        }
        const auto finer = compare_noise(set(0.6, true, 16 * step_dn, black_dn, 1),
                                         set(0.6 * 16, true, step_dn, black_dn, 2), std::nullopt,
                                         SensorLayout::named("mono"), settings);
        EXPECT_EQ(finer.test_rounded_dn, 16 * step_dn) << named;
      }
}

// A constant set is no camera's codes: bins of whole steps would call noise of 0.02 DN the same.
TEST(CompareNoise, AConstantSetIsNotRounded) {
  const Image dark = ramp(true);
  const auto result =
      compare_noise(frames_of(dark, {.sd = 0}, 4, 1), frames_of(dark, {.sd = 0.02}, 4, 2),
                    std::nullopt, SensorLayout::named("mono"), {});
  EXPECT_GT(result.pooled.sqrt_jsd, 0.5);
}

// Frames less a mean of n mix n frames' noise and, as whole numbers, are multiples of 1/n: combs
// whose teeth other counts lack, and so are few pixels' teeth of one count. Noise below the step is
// not normal, and mixtures come nearer.
TEST(CompareNoise, SetsOfAnyCountsWithoutTheirPatternAreTheSameNoise) {
  NoiseComparisonSettings settings;
  settings.remove_fixed_pattern = true;
  const auto mono = SensorLayout::named("mono");
  struct Case {
    int first = 0, second = 0;
    double sd = 3;  // in steps
    float step_dn = 1, black_dn = 0;
  };
  const auto set = [](const Case& of, int count, std::uint64_t seed) {
    const auto codes = frames_of(ramp(true), {.sd = of.sd, .rounded = true}, count, seed);
    return NoiseFrames{count, [=](int k) {
                         Image frame = codes.load(k);
                         for (float& v : frame.values()) v = of.step_dn * v - of.black_dn;
                         return frame;
                       }};
  };
  for (const Case& c : {Case{10, 40}, Case{2, 40}, Case{25, 20, 0.4}, Case{40, 40, 0.4},
                        Case{10, 40, 0.4, 1, 82.3f}, Case{10, 40, 3, 16}}) {
    const auto result =
        compare_noise(set(c, c.first, 1), set(c, c.second, 2), std::nullopt, mono, settings);
    const auto named = fmt::format("{} and {} frames, sd {} of {} DN, black {}", c.first, c.second,
                                   c.sd, c.step_dn, c.black_dn);
    EXPECT_LT(result.pooled.sqrt_jsd, 1.5 * result.pooled.sqrt_jsd_floor) << named;
    EXPECT_EQ(result.pooled.test_samples, std::int64_t{c.second} * kRows * kCols) << named;
    for (const NoiseDistance& level : result.levels)
      EXPECT_LT(level.sqrt_jsd, 2 * level.sqrt_jsd_floor) << named << " " << level.signal_dn;
    EXPECT_NEAR(result.test.between_frames, -1.0 / (c.second - 1), 0.01) << named;
  }
  const auto louder =
      compare_noise(set({}, 10, 1), set({.sd = 3.3}, 20, 2), std::nullopt, mono, settings);
  EXPECT_GT(louder.pooled.sqrt_jsd, 3 * louder.pooled.sqrt_jsd_floor);
}

}  // namespace
}  // namespace malus
