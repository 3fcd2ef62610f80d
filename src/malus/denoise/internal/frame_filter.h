// The default method's filter on a whole frame, tile by tile and scale by scale.
#pragma once

#include "malus/denoise/internal/memory_budget.h"
#include "malus/denoise/internal/mosaic_filter.h"

#include <algorithm>
#include <functional>

namespace malus::internal {

/// How a frame is cut.
struct FrameTiles {
  int count;
  double work;       ///< pixels of the tiles, their surroundings included, over those of the frame
  double whole_mib;  ///< memory with which it is one tile
};

/// What the filter tells of a frame's error; of what is null nothing.
struct FrameReport {
  Image* error = nullptr;       ///< expected squared error, of the frame's size
  Image* cell_error = nullptr;  ///< its means over the cells
  Image* unlike = nullptr;      ///< StageReport::unlike of all scales, the most; one value per cell
  /// Is called before any scale is filtered.
  std::function<void(const FrameTiles&)> planned = nullptr;
};

/// Number of cells that cover this many pixels along one axis.
constexpr int cell_count(int pixels) { return (pixels + kCell - 1) / kCell; }

/// Mean of value(row, col) over the pixels of cell (i, k) in a picture of this size.
template <class Value>
float cell_mean(int i, int k, int rows, int cols, const Value& value) {
  const int row_end = std::min((i + 1) * kCell, rows), col_end = std::min((k + 1) * kCell, cols);
  float sum = 0;
  for (int r = i * kCell; r < row_end; ++r)
    for (int c = k * kCell; c < col_end; ++c) sum += value(r, c);
  return sum / static_cast<float>((row_end - i * kCell) * (col_end - k * kCell));
}

/// Filters a frame whose noise has deviation 1 into `estimate`. All pictures have their size when
/// it is called. Tiles are cut so that they take no more than the memory; they do not change a byte
/// of the result. Returns how it was cut at full size. Throws InputError when the memory is too
/// little, Cancelled.
FrameTiles filter_frame(const FrameSource& frame, const MosaicFilterPlan& plan,
                        const MemoryBudget& memory, Image& estimate, const FrameReport& report,
                        Progress& progress);

}  // namespace malus::internal
