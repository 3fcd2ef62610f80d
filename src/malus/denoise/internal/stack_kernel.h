// What the vectorised inner loops of the mosaic filter work on: plain pointers into one tile.
#pragma once

#include "malus/denoise/internal/repeats.h"
#include "malus/denoise/internal/stack_stage.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace malus::internal {

/// Reference blocks [row_begin, row_end) x [col_begin, col_end) in steps of StackJob::step.
struct ReferenceBlock {
  int row_begin, row_end, col_begin, col_end;
};

/// ReferenceMap as plain pointers; by the frame's position of a reference.
template <class Value>
struct ReferenceValues {
  Value* values = nullptr;
  std::ptrdiff_t stride = 0;
  int rows = 0, cols = 0, step = 1, first_row = 0, first_col = 0;

  explicit operator bool() const { return values != nullptr; }
  /// Contract: a reference of the map's own pass.
  Value& at(int row, int col) const {
    return values[(row / step - first_row) * stride + col / step - first_col];
  }
  /// That of the nearest reference.
  Value& near(int row, int col) const {
    const int r = std::clamp(floor_div(row + step / 2, step) - first_row, 0, rows - 1);
    const int c = std::clamp(floor_div(col + step / 2, step) - first_col, 0, cols - 1);
    return values[r * stride + c];
  }
};

template <class Value, class Map>
ReferenceValues<Value> values_of(Map& map) {
  return {map.values.values().data(),
          map.values.cols(),
          map.values.rows(),
          map.values.cols(),
          map.step,
          map.first_row,
          map.first_col};
}

struct StackJob {
  const float* noisy;
  const float* guide;
  float* sum;
  float* weight;  ///< of stacks, at the first pixels of their blocks
  float* error;   ///< may be null; Stein's estimate, or
  bool noise;     ///< error is the noise let through, and every block of a stack has its own
  float* unlike;  ///< may be null; as weight, times how unlike the stacks' blocks are
  ReferenceValues<float> passed, excess, energy, settled;  ///< may be null
  ReferenceValues<const float> doubt;                      ///< may be null
  std::ptrdiff_t stride;
  int rows, cols;
  int row0, col0;  ///< frame position of the tile, for the alignment
  int frame_rows, frame_cols;
  StackFilter filter;
  int block_cells, step, search, far_step, stack;
  float threshold;
  float axes_prior;
  int period_rows, period_cols;
  Repeats repeats;  ///< that the windows do not hold
  float dct[kMaxBlockCells][kMaxBlockCells];
  std::vector<CellVector> window;  ///< per cell of the block
  const std::vector<CellMatrix>* rotations;
  const std::vector<CellMatrix>* priors;

  std::size_t alignment(int row, int col) const {
    const int r = ((row0 + row) % period_rows + period_rows) % period_rows;
    const int c = ((col0 + col) % period_cols + period_cols) % period_cols;
    return static_cast<std::size_t>(r * period_cols + c);
  }
};

void filter_references(const StackJob& job, const ReferenceBlock& block);

/// The blocks most similar to the one at (row, col), as filter_references stacks them: offsets of
/// their first pixels, the nearest first, of equal ones the earlier in the window. Returns how many
/// (a power of two); as many again follow where the windows have them, the next nearest.
int match_reference(const StackJob& job, int row, int col, std::vector<std::ptrdiff_t>& matches);

/// What principal_axes gives, of the upper triangles of up to kLanes matrices at once.
void axes_of_stacks(const CellMatrix* moments, int count, CellMatrix* axes);

inline constexpr int kGuideStep = 2;  ///< mosaic pixels between the cells that the guide averages

/// sum += matrices[alignment] (cell - mean) + mean for all cells of the lattice.
struct SmoothJob {
  const float* noisy;
  float* sum;
  std::ptrdiff_t stride;
  int cols;
  int row0, col0;
  int period_rows, period_cols;
  const CellVector* means;     ///< per alignment
  const CellMatrix* matrices;  ///< per alignment

  std::size_t alignment(int row, int col) const {
    const int r = ((row0 + row) % period_rows + period_rows) % period_rows;
    const int c = ((col0 + col) % period_cols + period_cols) % period_cols;
    return static_cast<std::size_t>(r * period_cols + c);
  }
};

void smooth_cells(const SmoothJob& job, int row_begin, int row_end);

}  // namespace malus::internal
