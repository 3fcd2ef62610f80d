// Estimates by small and by large blocks, mixed place by place.
#pragma once

#include "malus/image/view.h"

namespace malus::internal {

/// A tile's estimate and its expected squared error [noise variances], as run_stage gives them.
struct FilteredTile {
  Image pixels, error;
};

/// Mixed values depend on no input further away than this, in rows or columns.
inline constexpr int kMixReach = 24;

/// small.pixels come nearer to large's the less error large has around the place: by nothing where
/// it has more. (row0, col0) is the frame's position of (0, 0), so that tiles of a frame agree.
void mix_blocks(FilteredTile& small, const FilteredTile& large, int row0, int col0);

}  // namespace malus::internal
