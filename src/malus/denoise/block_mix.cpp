#include "malus/denoise/internal/block_mix.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/gaussian_means.h"
#include "malus/denoise/internal/stack_stage.h"

#include <algorithm>

namespace malus::internal {
namespace {

// Of the errors' difference [noise variances]: large blocks count alone where they are better by
// this, half where both are alike. Measured (docs/denoising-experiments.md, "Large blocks").
constexpr float kSpan = 0.01f;
// Of the neighbourhood whose mean decides, in cells: one pixel's estimate is mostly noise.
constexpr int kRadius = 5;
constexpr float kDeviation = 2.0f;
static_assert(kMixReach >= (kRadius + 1) * kCell);

// Means of small's error less large's over the frame's cells of 4x4 pixels.
Image gain_of_large(const FilteredTile& small, const FilteredTile& large, int row0, int col0) {
  const int rows = small.error.rows(), cols = small.error.cols();
  const int first_row = floor_div(row0, kCell), first_col = floor_div(col0, kCell);
  Image gain(floor_div(row0 + rows - 1, kCell) - first_row + 1,
             floor_div(col0 + cols - 1, kCell) - first_col + 1);
  parallel_for(0, gain.rows(), 8, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int i = static_cast<int>(begin); i < static_cast<int>(end); ++i) {
      const int top = std::max((first_row + i) * kCell - row0, 0),
                bottom = std::min((first_row + i + 1) * kCell - row0, rows);
      for (int r = top; r < bottom; ++r)
        for (int c = 0; c < cols; ++c)
          gain(i, floor_div(col0 + c, kCell) - first_col) +=
              (small.error(r, c) - large.error(r, c)) / (kCell * kCell);
    }
  });
  return gain;
}

}  // namespace

void mix_blocks(FilteredTile& small, const FilteredTile& large, int row0, int col0) {
  const Image gain = gaussian_means(gain_of_large(small, large, row0, col0), kDeviation, kRadius);
  const int first_row = floor_div(row0, kCell), first_col = floor_div(col0, kCell);
  const int rows = small.pixels.rows(), cols = small.pixels.cols();
  parallel_for(0, rows, 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < cols; ++c) {
        const float better =
            gain(floor_div(row0 + r, kCell) - first_row, floor_div(col0 + c, kCell) - first_col);
        const float share = std::clamp(0.5f + 0.5f * better / kSpan, 0.0f, 1.0f);
        small.pixels(r, c) += share * (large.pixels(r, c) - small.pixels(r, c));
      }
  });
}

}  // namespace malus::internal
