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

// For samples s = truth + n, an estimate f and means over a neighbourhood (s - f)² = n² - 2 n f +
// (f - truth)²: what the residual lacks of the noise's variance and the squared error of f are
// together twice the n f that f keeps. (Stein's unbiased estimate of the squared error, Ann.
// Statist. 9, 1981, asks for the error by n f.) No more is believed than an orthogonal projection
// keeps, all that its residual lacks.
KeptNoise measure_kept_noise(const PixelStrip& strip) {
  KeptNoise kept{strip.cell_map(), strip.cell_map(), {}};
  parallel_for(0, kept.all.rows(), kCellsOfTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int i = static_cast<int>(begin); i < static_cast<int>(end); ++i)
      for (int k = 0; k < kept.all.cols(); ++k) measure_cell(strip, i, k, kept);
  });
  kept.all = gaussian_means(kept.all, kNoiseDeviation, kNoiseRadius);
  kept.common = gaussian_means(kept.common, kNoiseDeviation, kNoiseRadius);
  kept.lack = kept.all;
  // Nobody states the error of the 2x2 pixels' means: theirs is taken to be the same share.
  const Image error = gaussian_means(strip.cell_error, kNoiseDeviation, kNoiseRadius);
  for (std::size_t i = 0; i < error.size(); ++i) {
    const float lack = kept.lack.values()[i];
    const float share = lack > 0 ? 0.5f + 0.5f * std::min(error.values()[i] / lack, 1.0f) : 0.5f;
    kept.all.values()[i] *= share;
    kept.common.values()[i] *= share;
  }
  return kept;
}

}  // namespace malus::internal
