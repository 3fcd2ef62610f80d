// Truth: what the two estimates are mixed of.
#include "malus/denoise/internal/block_mix.h"

#include "malus/base/random.h"

#include <algorithm>

#include <gtest/gtest.h>

namespace malus {
namespace {

using internal::FilteredTile;
using internal::kMixReach;

Image filled(int rows, int cols, float value) {
  Image image(rows, cols);
  for (float& v : image.values()) v = value;
  return image;
}

TEST(BlockMix, TakesTheEstimateOfLessErrorAndTheMeanOfEquals) {
  constexpr int kRows = 8, kCols = 48 + 2 * kMixReach + 48;
  constexpr int kEdge = kCols / 2;
  FilteredTile small{filled(kRows, kCols, 10), filled(kRows, kCols, 0.5f)};
  FilteredTile large{filled(kRows, kCols, 20), filled(kRows, kCols, 0.3f)};
  for (int r = 0; r < kRows; ++r)
    for (int c = kEdge; c < kCols; ++c) large.error(r, c) = 0.7f;
  mix_blocks(small, large, 2, -6);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) {
      if (c < kEdge - kMixReach) {
        EXPECT_FLOAT_EQ(small.pixels(r, c), 20) << r << ' ' << c;
      } else if (c > kEdge + kMixReach) {
        EXPECT_FLOAT_EQ(small.pixels(r, c), 10) << r << ' ' << c;
      }
      EXPECT_LE(small.pixels(r, c), small.pixels(r, std::max(c - 1, 0)));
    }

  FilteredTile equal{filled(kRows, kCols, 10), large.error};
  mix_blocks(equal, large, 2, -6);
  for (const float v : equal.pixels.values()) EXPECT_FLOAT_EQ(v, 15);
}

TEST(BlockMix, TilesAgreeWithTheFrame) {
  constexpr int kSize = 112, kTop = 6, kLeft = 10, kTile = 90;
  RandomSequence random(3, 0, Draw::kOther);
  const auto drawn = [&](float mean, float deviation) {
    Image image(kSize, kSize);
    for (float& v : image.values()) v = mean + deviation * static_cast<float>(random.normal());
    return image;
  };
  FilteredTile small{drawn(10, 1), drawn(0.3f, 0.1f)};
  const FilteredTile large{drawn(10, 1), drawn(0.3f, 0.1f)};
  const auto tile_of = [&](const Image& image) {
    Image tile(kTile, kTile);
    for (int r = 0; r < kTile; ++r)
      for (int c = 0; c < kTile; ++c) tile(r, c) = image(kTop + r, kLeft + c);
    return tile;
  };
  FilteredTile small_tile{tile_of(small.pixels), tile_of(small.error)};
  const FilteredTile large_tile{tile_of(large.pixels), tile_of(large.error)};
  const Image before = small.pixels;
  mix_blocks(small, large, -2, 4);
  mix_blocks(small_tile, large_tile, kTop - 2, kLeft + 4);
  int changed = 0;
  for (int r = kMixReach; r < kTile - kMixReach; ++r)
    for (int c = kMixReach; c < kTile - kMixReach; ++c) {
      ASSERT_EQ(small_tile.pixels(r, c), small.pixels(kTop + r, kLeft + c)) << r << ' ' << c;
      changed += small.pixels(kTop + r, kLeft + c) != before(kTop + r, kLeft + c);
    }
  EXPECT_GT(changed, 100);
}

}  // namespace
}  // namespace malus
