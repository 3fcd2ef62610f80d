// What the mosaic filter states of its own error (docs/uncertainty.md): the noise that
// its last pass let through, signal that it is likely to have lost beside the detail that it kept,
// and signal that the samples show and the estimate lacks. Where stacks hold true copies, nothing
// is lost.
#pragma once

#include "malus/denoise/internal/stack_stage.h"

namespace malus::internal {

/// A stated error depends on no estimate and no sample further away than this, in rows or columns.
constexpr int stated_error_reach(int period) {
  return 3 * kCell + (period > kCell ? period : kCell);
}

struct StatedErrorInput {
  const StackTile* noisy;  ///< unit noise
  const Image* estimate;   ///< same size, before a coarser scale corrects it
  const CellMap* kept;     ///< of the detail (detail_shrinkage.h); null: all of it
  const CellMap* unlike;   ///< of the last pass's stacks (StageReport::unlike)
  /// Of all coarser scales (TileReport::coarse_unlike); null: as if no block had a copy there.
  const Image* coarse_unlike;
  const ReferenceMap* doubt;  ///< of the last pass (pilot_doubt.h); null: none, 1 everywhere
  StackFilter filter;         ///< of the last pass
  int period_rows, period_cols;
  int frame_rows, frame_cols;
};

/// error: the noise let through, per pixel, becomes the expected squared error [noise variances].
/// Pixels beyond the frame keep what they have.
void state_error(const StatedErrorInput& input, Image& error);

}  // namespace malus::internal
