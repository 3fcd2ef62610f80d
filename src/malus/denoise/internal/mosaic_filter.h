// The filter of the methods bm3d and nl-ridge: collaborative filtering of the stabilised mosaic
// itself, for any layout. Similar blocks are searched at whole periods of the layout, so that
// colours and polarizer angles of a stack agree; inside a block every 4x4 pixels form a vector that
// is rotated into components learnt from the picture: in the first pass the principal components of
// the whole frame, in the others those of the stack itself, which follow the local colour and
// polarization (as PBM3D, Tibbs et al. 2018, and PFCD, 2025, do for a whole picture). References
// lie on a grid that is not a multiple of the cell, so that every alignment of cells and mosaic
// takes part and their estimates are averaged. What each of these earns is measured in
// docs/denoising-experiments.md.
#pragma once

#include "malus/denoise/internal/repeats.h"
#include "malus/denoise/internal/stack_stage.h"
#include "malus/image/layout.h"

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace malus {

struct MosaicFilterPlan {
  std::vector<internal::StackStage> hard;    ///< their mean is the first pilot
  std::vector<internal::StackStage> guided;  ///< each takes the one before it for its pilot
  /// Larger blocks with the first guided pass's pilot, mixed with that pass (block_mix.h).
  std::optional<internal::StackStage> large = std::nullopt;
  /// A Wiener filter by a few references, whose evidence says how far the first pilot is doubted;
  /// none: not at all.
  std::optional<internal::StackStage> survey = std::nullopt;
  bool repeats = false;        ///< stages look after the frame's steps too (repeats.h)
  float detail_threshold = 0;  ///< after the last pass (detail_shrinkage.h); 0: none is shrunk
  /// How the frame of half the size is filtered, which corrects the low frequencies
  /// (coarse_scale.h): one plan, or none for no such correction.
  std::vector<MosaicFilterPlan> coarse;
};
/// method: one whose filter is not kNone; all are one for layouts whose period divides no cell.
/// profile: one of denoise_profile_names. Throws InputError on others.
MosaicFilterPlan mosaic_filter_plan(const std::string& method, const std::string& profile,
                                    const SensorLayout& layout);

/// An output pixel depends on no input further away than this, in rows or columns; with_error: nor
/// does its expected error. repeat_reach: of the frame's repeats. Even.
int mosaic_filter_reach(const MosaicFilterPlan& plan, const SensorLayout& layout,
                        bool with_error = false, int repeat_reach = 0);

/// Nor on any pixel this far beyond the frame's border: references touch the frame, and only blocks
/// near them may lie outside. Even.
int mosaic_filter_border(const MosaicFilterPlan& plan, const SensorLayout& layout);

/// What the filter must know of the whole frame before it can work on a part of it.
struct CellStatistics {
  int period_rows = 1, period_cols = 1;
  std::vector<internal::CellVector> means;      ///< per alignment of cell and layout
  std::vector<internal::CellMatrix> rotations;  ///< principal axes
  /// sum over the axes but the first of w a a^T, w falling: added to the moments of a stack, it
  /// decides the axes of what its pilot does not tell from noise.
  std::vector<internal::CellMatrix> axes_prior;
  std::vector<internal::CellMatrix> smoothing;  ///< linear minimum mean-square estimate of a cell
  internal::Repeats repeats;
};

/// Stabilised pixel of the frame, row and col inside it.
using PixelSource = std::function<float(int row, int col)>;

/// A frame that is asked for pixel by pixel, so that no part holds a stabilised copy of all of it.
struct FrameSource {
  PixelSource pixel;
  const SensorLayout& layout;
  int rows, cols;
};
/// Of an image that outlives it.
inline FrameSource source_of(const Image& frame, const SensorLayout& layout) {
  return {[&frame](int row, int col) { return frame(row, col); }, layout, frame.rows(),
          frame.cols()};
}

/// All but the repeats, from at most about 65,000 cells per alignment, spread over the frame.
CellStatistics measure_cells(const FrameSource& frame);

/// Position inside [0, size) that stands for `position` beyond the border: mirrored by whole
/// periods, so that the channel stays the same.
int folded(int position, int size, int period);

/// The frame's rectangle extended by the filter's reach on every side, beyond the border by
/// folding.
internal::StackTile cut_tile(const FrameSource& frame, int row0, int col0, int rows, int cols);

/// What the filter tells of a tile's error; of what is null nothing.
struct TileReport {
  Image* variance = nullptr;            ///< expected squared error per pixel
  internal::CellMap* unlike = nullptr;  ///< of the tile: as StageReport::unlike
  /// For the variance: the most of it at all coarser scales, one value per cell of the frame of
  /// half the size; null where that is not known.
  const Image* coarse_unlike = nullptr;
};

/// Filters a tile whose noise has deviation 1; its row0 and col0 are even. Pixels at least
/// mosaic_filter_reach away from a tile's edge get the values that the whole frame would give them.
/// The same bytes for any thread count.
Image filter_mosaic(const internal::StackTile& noisy, int frame_rows, int frame_cols,
                    const CellStatistics& statistics, const MosaicFilterPlan& plan,
                    Progress& progress, const TileReport& report = {});

}  // namespace malus
