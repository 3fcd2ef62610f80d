#include "malus/denoise/internal/frame_filter.h"

#include "malus/denoise/internal/coarse_scale.h"
#include "malus/denoise/internal/memory_budget.h"

#include <algorithm>
#include <cmath>

namespace malus::internal {
namespace {

constexpr double kBytesPerTilePixel = 28;  // tile, guide, pilot, sums, weights, error
constexpr int kLeastCore = 128;

// The part of the frame that is filtered at once, without its surroundings.
struct TileSize {
  int rows, cols;
};

TileSize plan_tiles(int rows, int cols, int reach, double memory_mib, double resident_values) {
  const double pixels = (pixel_budget_bytes(memory_mib) - 4 * resident_values) / kBytesPerTilePixel;
  if ((rows + 2.0 * reach) * (cols + 2.0 * reach) <= pixels) return {rows, cols};
  const double side = std::sqrt(std::max(pixels, 0.0)) - 2.0 * reach;
  const double least = (kLeastCore + 2.0 * reach) * (kLeastCore + 2.0 * reach);
  if (side < kLeastCore)
    refuse_memory(memory_mib, least * kBytesPerTilePixel + 4 * resident_values, rows, cols);
  const int core = static_cast<int>(side) / 2 * 2;  // tiles begin at even pixels
  return {core, core};
}

void copy_core(const Image& tile, int margin, Image& frame, int row0, int col0, int rows,
               int cols) {
  for (int r = 0; r < rows; ++r)
    std::copy_n(tile.row(margin + r) + margin, cols, frame.row(row0 + r) + col0);
}

}  // namespace

int filter_frame(const PixelSource& pixel, const SensorLayout& layout, const MosaicFilterPlan& plan,
                 double memory_mib, double resident_values, Image& estimate, Image* error,
                 Progress& progress) {
  const int rows = estimate.rows(), cols = estimate.cols();
  const int reach = mosaic_filter_reach(plan, layout, error != nullptr);
  const TileSize size = plan_tiles(rows, cols, reach, memory_mib, resident_values);
  const CellStatistics statistics = measure_cells(pixel, rows, cols, layout);
  const int down = (rows + size.rows - 1) / size.rows;
  const int across = (cols + size.cols - 1) / size.cols;
  progress.begin("denoising", down * across);
  for (int t = 0; t < down * across; ++t) {
    const int row0 = t / across * size.rows, col0 = t % across * size.cols;
    const int core_rows = std::min(size.rows, rows - row0);
    const int core_cols = std::min(size.cols, cols - col0);
    const StackTile tile = cut_tile(pixel, rows, cols, row0 - reach, col0 - reach,
                                    core_rows + 2 * reach, core_cols + 2 * reach, layout);
    Image tile_error;
    const Image filtered =
        filter_mosaic(tile, rows, cols, statistics, plan, progress, error ? &tile_error : nullptr);
    copy_core(filtered, reach, estimate, row0, col0, core_rows, core_cols);
    if (error) copy_core(tile_error, reach, *error, row0, col0, core_rows, core_cols);
    progress.advance(1);
  }
  if (!plan.coarse.empty() && has_coarse_scale(rows, cols, layout)) {
    Image coarse = coarse_frame(pixel, rows, cols, layout);
    Image coarse_estimate(coarse.rows(), coarse.cols());
    filter_frame([&](int r, int c) { return coarse(r, c); }, layout, plan.coarse.front(),
                 memory_mib, resident_values + 2.0 * static_cast<double>(coarse.size()),
                 coarse_estimate, nullptr, progress);
    coarse = Image();  // the correction needs as much again, twice
    correct_low_frequencies(estimate, coarse_estimate, layout);
  }
  return down * across;
}

}  // namespace malus::internal
