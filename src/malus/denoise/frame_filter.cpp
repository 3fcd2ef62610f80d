#include "malus/denoise/internal/frame_filter.h"

#include "malus/denoise/internal/coarse_scale.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace malus::internal {
namespace {

constexpr double kBytesPerTilePixel = 28;  // tile, guide, pilot, sums, weights, error
constexpr int kLeastCore = 128;

// The part of the frame that is filtered at once, without its surroundings.
struct TileSize {
  int rows, cols;
};

// How far a tile's pixels and their surroundings reach, inside the frame and beyond it.
struct Reach {
  int inside, beyond;
  Reach(const MosaicFilterPlan& plan, const SensorLayout& layout, const FrameReport& report,
        int repeat_reach)
      : inside(mosaic_filter_reach(plan, layout, report.error || report.cell_error, repeat_reach) +
               (report.cell_error ? kCell : 0)),
        beyond(std::min(mosaic_filter_border(plan, layout), inside)) {}
};

double frame_pixels(int rows, int cols, const Reach& reach) {
  return (rows + 2.0 * reach.beyond) * (cols + 2.0 * reach.beyond);
}

// The memory has been found to be enough.
TileSize plan_tiles(int rows, int cols, const Reach& reach, const MemoryBudget& memory) {
  const double pixels = memory.bytes() / kBytesPerTilePixel;
  if (frame_pixels(rows, cols, reach) <= pixels) return {rows, cols};
  const double side = std::max(std::sqrt(std::max(pixels, 0.0)) - 2.0 * reach.inside,
                               static_cast<double>(kLeastCore));
  const int core = static_cast<int>(side) / 2 * 2;  // tiles begin at even pixels
  return {core, core};
}

// What a scale holds while the one below it is filtered and after that, in frames of that size.
constexpr double kHeldBelow = 2, kHeldAfter = 1;

// The memory that a frame takes at least, all of its scales.
double least_bytes(int rows, int cols, const MosaicFilterPlan& plan, const SensorLayout& layout,
                   const FrameReport& report, int repeat_reach) {
  const Reach reach(plan, layout, report, repeat_reach);
  const double side = kLeastCore + 2.0 * reach.inside;
  const double tile = kBytesPerTilePixel * std::min(side * side, frame_pixels(rows, cols, reach));
  const auto coarse = plan.coarse.empty() ? std::nullopt : coarse_size(rows, cols, layout);
  if (!coarse) return tile;
  const double frame = kBytesPerValue * coarse->rows * coarse->cols;
  return std::max(tile + kHeldAfter * frame,
                  kHeldBelow * frame +
                      least_bytes(coarse->rows, coarse->cols, plan.coarse.front(), layout, {}, 0));
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

// A frame's tiles, row by row.
struct Tiling {
  int rows, cols;
  Reach reach;
  TileSize size;
  int down, across;
  Tiling(int frame_rows, int frame_cols, const Reach& around, const MemoryBudget& memory)
      : rows(frame_rows),
        cols(frame_cols),
        reach(around),
        size(plan_tiles(rows, cols, reach, memory)),
        down((rows + size.rows - 1) / size.rows),
        across((cols + size.cols - 1) / size.cols) {}

  Span rows_of(int t) const { return {t / across, size.rows, rows, reach.inside, reach.beyond}; }
  Span cols_of(int t) const { return {t % across, size.cols, cols, reach.inside, reach.beyond}; }
  FrameTiles told(const MemoryBudget& memory) const {
    const double whole = frame_pixels(rows, cols, reach);
    double pixels = 0;
    for (int t = 0; t < down * across; ++t)
      pixels += static_cast<double>(rows_of(t).tile_size()) * cols_of(t).tile_size();
    return {down * across, pixels / whole, memory.mib_for(kBytesPerTilePixel * whole)};
  }
};

void copy_core(const Image& tile, const Span& down, const Span& across, Image& frame) {
  for (int r = down.begin; r < down.end; ++r)
    std::copy_n(tile.row(r - down.tile_begin) + (across.begin - across.tile_begin),
                across.end - across.begin, frame.row(r) + across.begin);
}

// Means over the cells of the core; those that reach beyond it have the same value in both tiles,
// whose surroundings are larger by a cell for that.
void copy_core_means(const Image& tile, const Span& down, const Span& across, int rows, int cols,
                     Image& frame) {
  for (int i = down.begin / kCell; i < cell_count(down.end); ++i)
    for (int k = across.begin / kCell; k < cell_count(across.end); ++k)
      frame(i, k) = cell_mean(i, k, rows, cols, [&](int r, int c) {
        return tile(r - down.tile_begin, c - across.tile_begin);
      });
}

// The cells of the core; those that reach beyond it have the same value in both tiles.
void copy_core_cells(const CellMap& tile, const Span& down, const Span& across, Image& frame) {
  for (int i = down.begin / kCell; i < cell_count(down.end); ++i)
    std::copy_n(tile.values.row(i - tile.first_row) + (across.begin / kCell - tile.first_col),
                cell_count(across.end) - across.begin / kCell, frame.row(i) + across.begin / kCell);
}

void take_larger(Image& unlike, const Image& coarse) {
  for (int i = 0; i < unlike.rows(); ++i)
    for (int k = 0; k < unlike.cols(); ++k)
      unlike(i, k) = std::max(unlike(i, k), coarse(std::min(i / 2, coarse.rows() - 1),
                                                   std::min(k / 2, coarse.cols() - 1)));
}

// Of the frame of half the size, which corrects the low frequencies.
struct CoarseScale {
  Image estimate;
  Image unlike;  ///< of its cells; empty where it is not asked for
};

std::optional<CoarseScale> filter_coarse(const FrameSource& frame, const MosaicFilterPlan& plan,
                                         const MemoryBudget& memory, bool want_unlike,
                                         Progress& progress) {
  if (plan.coarse.empty() || !coarse_size(frame.rows, frame.cols, frame.layout))
    return std::nullopt;
  const Image halved = coarse_frame(frame);
  CoarseScale coarse{Image(halved.rows(), halved.cols()), Image()};
  if (want_unlike) coarse.unlike = Image(cell_count(halved.rows()), cell_count(halved.cols()));
  filter_frame(source_of(halved, frame.layout), plan.coarse.front(),
               memory.holding(kHeldBelow * static_cast<double>(halved.size())), coarse.estimate,
               {.unlike = want_unlike ? &coarse.unlike : nullptr}, progress);
  return coarse;
}

}  // namespace

FrameTiles filter_frame(const FrameSource& frame, const MosaicFilterPlan& plan,
                        const MemoryBudget& memory, Image& estimate, const FrameReport& report,
                        Progress& progress) {
  const SensorLayout& layout = frame.layout;
  const int rows = frame.rows, cols = frame.cols;
  check_stop(progress);
  CellStatistics statistics = measure_cells(frame);
  if (plan.repeats) statistics.repeats = find_repeats(frame);
  const int repeat_reach = statistics.repeats.reach();
  const double least = least_bytes(rows, cols, plan, layout, report, repeat_reach);
  if (least > memory.bytes()) memory.refuse(least, rows, cols);
  const bool with_error = report.error || report.cell_error;
  // One coarse scale, as Wiener filters have, tells no even light: slow light is alike there too.
  const bool many_scales = plan.guided.back().filter == StackFilter::ridge;
  const auto halved = plan.coarse.empty() ? std::nullopt : coarse_size(rows, cols, layout);
  const MemoryBudget left =
      halved ? memory.holding(kHeldAfter * halved->rows * halved->cols) : memory;
  const Tiling tiling(rows, cols, Reach(plan, layout, report, repeat_reach), left);
  const FrameTiles tiles = tiling.told(left);
  if (report.planned) report.planned(tiles);
  const std::optional<CoarseScale> coarse =
      filter_coarse(frame, plan, memory, report.unlike || (with_error && many_scales), progress);
  progress.begin("denoising", tiles.count);
  for (int t = 0; t < tiles.count; ++t) {
    const Span v = tiling.rows_of(t), h = tiling.cols_of(t);
    const StackTile tile =
        cut_tile(frame, v.tile_begin, h.tile_begin, v.tile_size(), h.tile_size());
    Image tile_error;
    std::optional<CellMap> unlike;
    if (report.unlike) unlike.emplace(tile);
    const Image filtered = filter_mosaic(
        tile, rows, cols, statistics, plan, progress,
        {.variance = with_error ? &tile_error : nullptr,
         .unlike = unlike ? &*unlike : nullptr,
         .coarse_unlike = coarse && coarse->unlike.size() ? &coarse->unlike : nullptr});
    copy_core(filtered, v, h, estimate);
    if (report.error) copy_core(tile_error, v, h, *report.error);
    if (report.cell_error) copy_core_means(tile_error, v, h, rows, cols, *report.cell_error);
    if (unlike) copy_core_cells(*unlike, v, h, *report.unlike);
    progress.advance(1);
  }
  if (report.unlike && !plan.coarse.empty())
    take_larger(*report.unlike, coarse ? coarse->unlike : Image(1, 1, kUnlikeAny));
  if (coarse) correct_low_frequencies(estimate, coarse->estimate, layout);
  return tiles;
}

}  // namespace malus::internal
