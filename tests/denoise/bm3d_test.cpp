#include "malus/denoise/bm3d.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/random.h"
#include "malus/denoise/internal/bm3d_pass.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "bm3d_plain.h"
#include <gtest/gtest.h>
#include <hwy/targets.h>

namespace malus {
namespace {

/// Edges, a slope and a texture: something to match and something to preserve.
Planes test_picture(int channels, int rows, int cols) {
  Planes planes(channels, rows, cols);
  for (int ch = 0; ch < channels; ++ch)
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c)
        planes[ch](r, c) =
            static_cast<float>(100 + (r + 2 * c > 60 ? 40 * (ch + 1) : 0) + r * 0.5 +
                               20 * std::sin(2 * std::numbers::pi * (r + c) / 6) * (c % 40 < 20));
  return planes;
}

Planes with_noise(Planes planes, float sigma, std::uint64_t seed) {
  for (int c = 0; c < planes.channels(); ++c) {
    RandomSequence random(seed, static_cast<std::uint32_t>(c), Draw::kOther);
    for (float& value : planes[c].values()) value += sigma * static_cast<float>(random.normal());
  }
  return planes;
}

double mean_squared_difference(const Image& a, const Image& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double d = double{a.values()[i]} - double{b.values()[i]};
    sum += d * d;
  }
  return sum / static_cast<double>(a.size());
}

double largest_difference(const Image& a, const Image& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    largest = std::max(largest, std::abs(double{a.values()[i]} - double{b.values()[i]}));
  return largest;
}

struct PlainCase {
  int channels, rows, cols, step, range, group;
};

class Bm3dAgainstPlain : public ::testing::TestWithParam<PlainCase> {};

// A coefficient or a distance at its limit may fall on the other side in float: a few pixels may
// differ by a fraction of sigma, the rest by rounding.
TEST_P(Bm3dAgainstPlain, IsTheSame) {
  const auto [channels, rows, cols, step, range, group] = GetParam();
  const internal::Bm3dStage hard{step, range, group, 3.0F};
  const internal::Bm3dStage wiener{step, range, group, 1.0F};
  const internal::Bm3dParameters parameters{hard, 2.7F, wiener};
  const std::vector<float> all_sigma = {10.0F, 5.0F, 8.0F}, all_weights = {1.0F, 0.0F, 0.5F};
  const std::span sigma(all_sigma.data(), static_cast<std::size_t>(channels));
  const std::span weights(all_weights.data(), static_cast<std::size_t>(channels));
  const Planes noisy = with_noise(test_picture(channels, rows, cols), 10.0F, 7);

  const Planes fast =
      internal::bm3d_with(parameters, noisy, sigma, weights, silent_progress(), nullptr);
  using internal::plain::pass;
  const Planes basic = pass(noisy, sigma, weights, hard, parameters.hard_threshold, nullptr);
  const Planes slow = pass(noisy, sigma, weights, wiener, 0, &basic);
  for (int c = 0; c < channels; ++c) {
    EXPECT_LT(std::sqrt(mean_squared_difference(fast[c], slow[c])), 2e-3 * all_sigma[c]);
    EXPECT_LT(largest_difference(fast[c], slow[c]), 0.1 * all_sigma[c]);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Sizes, Bm3dAgainstPlain,
    ::testing::Values(PlainCase{1, 1, 1, 3, 4, 16}, PlainCase{1, 1, 29, 3, 5, 16},
                      PlainCase{1, 31, 1, 4, 5, 8}, PlainCase{3, 9, 8, 2, 3, 32},
                      PlainCase{1, 41, 53, 3, 7, 16}, PlainCase{2, 37, 30, 3, 4, 32},
                      PlainCase{3, 33, 31, 3, 4, 8}));
INSTANTIATE_TEST_SUITE_P(
    Steps, Bm3dAgainstPlain,
    ::testing::Values(PlainCase{1, 27, 33, 1, 3, 8}, PlainCase{1, 27, 66, 2, 3, 16},
                      PlainCase{1, 29, 30, 4, 6, 32}, PlainCase{1, 28, 30, 5, 6, 4},
                      PlainCase{1, 28, 31, 6, 6, 2}, PlainCase{1, 28, 33, 7, 6, 1},
                      PlainCase{1, 40, 28, 8, 9, 16}));
// More than one tile of reference blocks in both directions; the second reaches into the first from
// below, by more rows than there are between rows of reference blocks, and by fewer.
INSTANTIATE_TEST_SUITE_P(Tiles, Bm3dAgainstPlain,
                         ::testing::Values(PlainCase{1, 100, 110, 3, 2, 8},
                                           PlainCase{1, 70, 100, 3, 8, 16},
                                           PlainCase{2, 130, 250, 8, 2, 4}));

TEST(Bm3d, RemovesMostOfTheNoiseOfAFlatPicture) {
  for (const char* profile : {"fast", "normal", "high"}) {
    const Planes clean(1, 64, 50);
    const std::array sigma = {2.0F};
    const Planes result = bm3d(with_noise(clean, sigma[0], 1), sigma, {.profile = profile});
    EXPECT_LT(mean_squared_difference(result[0], clean[0]), 4.0 / 25) << profile;
  }
}

// A random picture of a thousand deviations: none of its coefficients is taken for noise.
TEST(Bm3d, StatesTheNoiseItselfWhereNothingIsTakenOut) {
  const Planes picture = with_noise(Planes(1, 50, 60), 3000, 11);
  const std::array sigma = {3.0F};
  Planes variance;
  (void)bm3d(picture, sigma, {}, {}, silent_progress(), &variance);
  for (const float stated : variance[0].values()) ASSERT_NEAR(stated, 9.0F, 0.01F * 9.0F);
}

TEST(Bm3d, GivesConstantPlanesBackExactly) {
  Planes planes(2, 50, 37);
  std::ranges::fill(planes[0].values(), 1234.567F);
  std::ranges::fill(planes[1].values(), -0.1F);
  const std::array sigma = {3.0F, 7.0F};
  const Planes result = bm3d(planes, sigma, {.profile = "normal"});
  EXPECT_EQ(result[0].values(), planes[0].values());
  EXPECT_EQ(result[1].values(), planes[1].values());
}

TEST(Bm3d, IsTheSameForAnyNumberOfThreads) {
  const Planes noisy = with_noise(test_picture(2, 210, 250), 20, 3);
  const std::array sigma = {20.0F, 20.0F};
  std::vector<Planes> results;
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    results.push_back(bm3d(noisy, sigma, {.profile = "fast"}));
  }
  set_thread_count(0);
  for (int c = 0; c < 2; ++c) {
    EXPECT_EQ(results[0][c].values(), results[1][c].values());
    EXPECT_EQ(results[0][c].values(), results[2][c].values());
  }
}

// Integers in the matching, vectors of one width in the filters: the instruction set is of no
// consequence.
TEST(Bm3d, IsTheSameOnEveryInstructionSet) {
  const Planes noisy = with_noise(test_picture(1, 60, 70), 20, 9);
  const std::array sigma = {20.0F};
  const Planes expected = bm3d(noisy, sigma, {});
  const std::int64_t supported = hwy::SupportedTargets();
  int tried = 0;
  for (std::int64_t rest = supported; rest != 0; rest &= rest - 1) {
    hwy::SetSupportedTargetsForTest(rest & -rest);
    EXPECT_EQ(bm3d(noisy, sigma, {})[0].values(), expected[0].values())
        << hwy::TargetName(rest & -rest);
    ++tried;
  }
  hwy::SetSupportedTargetsForTest(0);
  EXPECT_GE(tried, 1);
}

// Coefficients of 1e18 deviations and more, whose powers' product is no float any more, pass whole.
TEST(Bm3d, LeavesAPictureWithHardlyAnyNoiseAsItIs) {
  Planes noisy = test_picture(1, 60, 70);
  for (float& value : noisy[0].values()) value *= 1e9F;
  const std::array sigma = {1e-8F};
  Planes variance;
  const Planes result = bm3d(noisy, sigma, {}, {}, silent_progress(), &variance);
  for (std::size_t i = 0; i < noisy[0].size(); ++i) {
    ASSERT_NEAR(result[0].values()[i], noisy[0].values()[i], 1e-6 * noisy[0].values()[i]);
    ASSERT_TRUE(std::isfinite(variance[0].values()[i]));
  }
}

// The noise deviation is the only scale there is; a factor of 4 is exact in float.
TEST(Bm3d, FollowsAChangeOfUnit) {
  const Planes noisy = with_noise(test_picture(1, 60, 70), 20, 4);
  Planes scaled = noisy;
  for (float& value : scaled[0].values()) value *= 4;
  const std::array sigma = {20.0F}, scaled_sigma = {80.0F};
  const Planes result = bm3d(noisy, sigma, {}), scaled_result = bm3d(scaled, scaled_sigma, {});
  for (std::size_t i = 0; i < result[0].size(); ++i)
    ASSERT_EQ(4 * result[0].values()[i], scaled_result[0].values()[i]);
}

TEST(Bm3d, LeavesAChannelWithoutNoiseAlone) {
  const Planes noisy = with_noise(test_picture(2, 30, 40), 20, 5);
  const std::array sigma = {0.0F, 20.0F};
  Planes variance;
  const Planes result = bm3d(noisy, sigma, {}, {}, silent_progress(), &variance);
  EXPECT_EQ(result[0].values(), noisy[0].values());
  EXPECT_EQ(*std::ranges::max_element(variance[0].values()), 0.0F);
  EXPECT_GT(*std::ranges::min_element(variance[1].values()), 0.0F);
}

// A tile at a multiple of the grid with the promised context gives the picture's own values.
TEST(Bm3d, TiledEqualsWhole) {
  const internal::Bm3dParameters parameters{{3, 6, 16, 3.0F}, 2.7F, {3, 6, 16, 1.0F}};
  const auto reach = internal::bm3d_reach(parameters);
  const int side = reach.grid, margin = (reach.pixels + reach.grid - 1) / reach.grid * reach.grid;
  const int rows = 40, cols = 2 * margin + side + 50;
  const Planes noisy = with_noise(test_picture(1, rows, cols), 20, 6);
  const std::array sigma = {20.0F};
  const Planes whole =
      internal::bm3d_with(parameters, noisy, sigma, {}, silent_progress(), nullptr);
  // The tile's own columns: [margin, margin + side) of the picture; its right context is short of
  // the picture's end by 10 columns.
  const int first = 0, last = cols - 10;
  Planes part(1, rows, last - first);
  for (int r = 0; r < rows; ++r)
    for (int c = first; c < last; ++c) part[0](r, c - first) = noisy[0](r, c);
  const Planes left = internal::bm3d_with(parameters, part, sigma, {}, silent_progress(), nullptr);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < last - reach.pixels; ++c) ASSERT_EQ(left[0](r, c), whole[0](r, c));
  Planes rest(1, rows, cols - side);
  for (int r = 0; r < rows; ++r)
    for (int c = side; c < cols; ++c) rest[0](r, c - side) = noisy[0](r, c);
  const Planes right = internal::bm3d_with(parameters, rest, sigma, {}, silent_progress(), nullptr);
  for (int r = 0; r < rows; ++r)
    for (int c = side + reach.pixels; c < cols; ++c)
      ASSERT_EQ(right[0](r, c - side), whole[0](r, c));
}

// Channels with the same structure match better together than the noisier one does alone.
TEST(Bm3d, SharedMatchingHelpsTheNoisierChannel) {
  const Planes clean = test_picture(2, 90, 90);
  Planes noisy = with_noise(clean, 8, 8);
  for (std::size_t i = 0; i < clean[0].size(); ++i)
    noisy[1].values()[i] = clean[1].values()[i] + 5 * (noisy[1].values()[i] - clean[1].values()[i]);
  const std::array sigma = {8.0F, 40.0F};
  const std::array first_only = {1.0F, 0.0F}, second_only = {0.0F, 1.0F};
  const Planes joint = bm3d(noisy, sigma, {}, first_only),
               own = bm3d(noisy, sigma, {}, second_only);
  EXPECT_LT(mean_squared_difference(joint[1], clean[1]),
            0.9 * mean_squared_difference(own[1], clean[1]));
}

TEST(Bm3d, RefusesAnUnknownProfile) {
  const Planes planes(1, 8, 8);
  const std::array sigma = {1.0F};
  EXPECT_THROW((void)bm3d(planes, sigma, {.profile = "best"}), InputError);
  EXPECT_THROW((void)bm3d_reach({.profile = ""}), InputError);
}

}  // namespace
}  // namespace malus
