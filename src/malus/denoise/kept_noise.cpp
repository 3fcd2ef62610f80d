#include "malus/denoise/internal/kept_noise.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/gaussian_means.h"

#include <algorithm>
#include <cstddef>

namespace malus::internal {
namespace {

constexpr float kNoiseDeviation = 4.0f;  // of the neighbourhoods, in cells
constexpr int kCellsOfTask = 8;          // rows of cells

// Sum over the cell's pixels of the squared deviation of their groups' means.
float common_residual(const PixelStrip& strip, int i, int k) {
  float sum = 0;
  strip.for_groups(i, k, [&](const PixelGroup& group) {
    bool is_known = true;
    const float mean = group.mean([&](int r, int c) {
      is_known = is_known && !strip.is_cut_off(r, c);
      return strip.samples(r, c) - strip.estimate(r, c);
    });
    const auto size = static_cast<float>(group.size());
    sum += size * (is_known ? size * mean * mean : strip.sure_noise);
  });
  return sum;
}

}  // namespace

// An orthogonal projection that keeps the share p of the noise leaves a squared residual of 1 - p.
KeptNoise measure_kept_noise(const PixelStrip& strip) {
  KeptNoise kept{strip.cell_map(), strip.cell_map()};
  parallel_for(0, kept.all.rows(), kCellsOfTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin) * kCell;
         r < std::min(static_cast<int>(end) * kCell, strip.rows()); ++r)
      for (int c = 0; c < strip.cols(); ++c) {
        const float rest = strip.samples(r, c) - strip.estimate(r, c);
        kept.all(r / kCell, c / kCell) += strip.is_cut_off(r, c) ? strip.sure_noise : rest * rest;
      }
    for (int i = static_cast<int>(begin); i < static_cast<int>(end); ++i)
      for (int k = 0; k < kept.all.cols(); ++k) {
        const auto pixels = static_cast<float>(strip.pixels_of(i, k));
        kept.all(i, k) = strip.sure_noise - kept.all(i, k) / pixels;
        kept.common(i, k) = strip.sure_noise - common_residual(strip, i, k) / pixels;
      }
  });
  kept.all = gaussian_means(kept.all, kNoiseDeviation, kNoiseRadius);
  kept.common = gaussian_means(kept.common, kNoiseDeviation, kNoiseRadius);
  return kept;
}

}  // namespace malus::internal
