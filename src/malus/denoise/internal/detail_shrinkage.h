// The last step of a scale: detail that holds no more energy than the noise which the last pass let
// through is that noise, and is taken back. Stacks cannot do it: where light changes smoothly every
// stack spends a few coefficients on the change, and each lets noise through that is coarser than a
// block. Larger blocks, without any matching, have enough coefficients to tell: beside those few
// they hold nothing but that noise. Where a frequency holds detail in any component, all
// components keep theirs.
#pragma once

#include "malus/denoise/internal/stack_stage.h"

namespace malus::internal {

inline constexpr int kDetailSide = 16;  ///< cells per side of a block
inline constexpr int kDetailBlock = kDetailSide * kCell;

/// Shrinks the detail of a tile's estimate. axes: principal axes of the frame's cells at multiples
/// of kCell, as columns, the strongest first. passed: of the pass that made the estimate.
/// threshold: detail of this many times the passed noise keeps half of itself. A pixel depends on
/// no estimate that is kDetailBlock away. kept, when given: how much of the detail's coefficients
/// is kept, mean over the blocks around a cell. Contract: a cell holds whole periods of the layout.
Image shrink_detail(const StackTile& estimate, int frame_rows, int frame_cols,
                    const CellMatrix& axes, const ReferenceMap& passed, float threshold,
                    CellMap* kept = nullptr);

}  // namespace malus::internal
