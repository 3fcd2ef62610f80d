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

TileSize plan_tiles(int rows, int cols, int reach, int border, double memory_mib,
                    double resident_values) {
  const double pixels = (pixel_budget_bytes(memory_mib) - 4 * resident_values) / kBytesPerTilePixel;
  if ((rows + 2.0 * border) * (cols + 2.0 * border) <= pixels) return {rows, cols};
  const double side = std::sqrt(std::max(pixels, 0.0)) - 2.0 * reach;
  const double least = std::min((kLeastCore + 2.0 * reach) * (kLeastCore + 2.0 * reach),
                                (rows + 2.0 * border) * (cols + 2.0 * border));
  if (side < kLeastCore)
    refuse_memory(memory_mib, least * kBytesPerTilePixel + 4 * resident_values, rows, cols);
  const int core = static_cast<int>(side) / 2 * 2;  // tiles begin at even pixels
  return {core, core};
}

// [begin, end) of the frame along one side, and what a tile holds of it with its surroundings.
struct Span {
  int begin, end, tile_begin, tile_end;
  Span(int tile, int size, int frame, int reach, int border)
      : begin(tile * size),
        end(std::min(begin + size, frame)),
        tile_begin(std::max(begin - reach, -border)),
        tile_end(std::min(end + reach, frame + border)) {}
  int tile_size() const { return tile_end - tile_begin; }
};

void copy_core(const Image& tile, const Span& down, const Span& across, Image& frame) {
  for (int r = down.begin; r < down.end; ++r)
    std::copy_n(tile.row(r - down.tile_begin) + (across.begin - across.tile_begin),
                across.end - across.begin, frame.row(r) + across.begin);
}

}  // namespace

int filter_frame(const PixelSource& pixel, const SensorLayout& layout, const MosaicFilterPlan& plan,
                 double memory_mib, double resident_values, Image& estimate, Image* error,
                 Progress& progress) {
  const int rows = estimate.rows(), cols = estimate.cols();
  const int reach = mosaic_filter_reach(plan, layout, error != nullptr);
  const int border = std::min(mosaic_filter_border(plan, layout), reach);
  const TileSize size = plan_tiles(rows, cols, reach, border, memory_mib, resident_values);
  const CellStatistics statistics = measure_cells(pixel, rows, cols, layout);
  const int down = (rows + size.rows - 1) / size.rows;
  const int across = (cols + size.cols - 1) / size.cols;
  progress.begin("denoising", down * across);
  for (int t = 0; t < down * across; ++t) {
    const Span v(t / across, size.rows, rows, reach, border);
    const Span h(t % across, size.cols, cols, reach, border);
    const StackTile tile = cut_tile(pixel, rows, cols, v.tile_begin, h.tile_begin, v.tile_size(),
                                    h.tile_size(), layout);
    Image tile_error;
    const Image filtered =
        filter_mosaic(tile, rows, cols, statistics, plan, progress, error ? &tile_error : nullptr);
    copy_core(filtered, v, h, estimate);
    if (error) copy_core(tile_error, v, h, *error);
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
