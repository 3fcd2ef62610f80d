#include "malus/denoise/internal/kept_noise.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/gaussian_means.h"

#include <algorithm>
#include <cstddef>

namespace malus::internal {
namespace {

constexpr float kNoiseDeviation = 4.0f;  // of the neighbourhoods, in cells
constexpr int kCellsOfTask = 8;          // rows of cells

// Of the pixels of a cell, and of their groups' means, each counted for the pixels of its group:
// what the squared residual lacks of the noise's variance. Where noise is cut off it tells nothing.
void measure_cell(const PixelStrip& strip, int i, int k, KeptNoise& kept) {
  float all = 0, common = 0;
  strip.for_groups(i, k, [&](const PixelGroup& group) {
    float variance = 0, rest = 0;
    bool is_known = true;
    for (int r = group.row; r < group.row_end; ++r)
      for (int c = group.col; c < group.col_end; ++c) {
        if (strip.is_cut_off(r, c)) {
          is_known = false;
          continue;
        }
        const float own = strip.samples(r, c) - strip.estimate(r, c);
        const float own_variance = strip.variance(r, c);
        all += own_variance - own * own;
        variance += own_variance;
        rest += own;
      }
    if (is_known) common += variance - rest * rest;
  });
  const auto pixels = static_cast<float>(strip.pixels_of(i, k));
  kept.all(i, k) = all / pixels;
  kept.common(i, k) = common / pixels;
}

}  // namespace

// An orthogonal projection that keeps the share p of the noise leaves a squared residual of 1 - p.
KeptNoise measure_kept_noise(const PixelStrip& strip) {
  KeptNoise kept{strip.cell_map(), strip.cell_map()};
  parallel_for(0, kept.all.rows(), kCellsOfTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int i = static_cast<int>(begin); i < static_cast<int>(end); ++i)
      for (int k = 0; k < kept.all.cols(); ++k) measure_cell(strip, i, k, kept);
  });
  kept.all = gaussian_means(kept.all, kNoiseDeviation, kNoiseRadius);
  kept.common = gaussian_means(kept.common, kNoiseDeviation, kNoiseRadius);
  return kept;
}

}  // namespace malus::internal
