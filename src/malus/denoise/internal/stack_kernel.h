// What the vectorised inner loops of the mosaic filter work on: plain pointers into one tile.
#pragma once

#include "malus/denoise/internal/stack_stage.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace malus::internal {

/// Reference blocks [row_begin, row_end) x [col_begin, col_end) in steps of StackJob::step.
struct ReferenceBlock {
  int row_begin, row_end, col_begin, col_end;
};

struct StackJob {
  const float* noisy;
  const float* guide;
  float* sum;
  float* weight;  ///< of stacks, at the first pixels of their blocks
  float* error;   ///< may be null; Stein's estimate, or
  bool noise;     ///< error is the noise let through, and every block of a stack has its own
  float* unlike;  ///< may be null; as weight, times how unlike the stacks' blocks are
  float* passed;  ///< may be null; of the references from first_row and first_col on, in steps
  std::ptrdiff_t passed_stride;
  int first_row, first_col;
  std::ptrdiff_t stride;
  int rows, cols;
  int row0, col0;  ///< frame position of the tile, for the alignment
  int frame_rows, frame_cols;
  StackFilter filter;
  int block_cells, step, search, far_step, stack;
  float threshold;
  float axes_prior;
  int period_rows, period_cols;
  float dct[kMaxBlockCells][kMaxBlockCells];
  std::vector<CellVector> window;  ///< per cell of the block
  const std::vector<CellMatrix>* rotations;
  const std::vector<CellMatrix>* priors;

  std::size_t alignment(int row, int col) const {
    const int r = ((row0 + row) % period_rows + period_rows) % period_rows;
    const int c = ((col0 + col) % period_cols + period_cols) % period_cols;
    return static_cast<std::size_t>(r * period_cols + c);
  }
  float& passed_of(int row, int col) const {
    return passed[((row0 + row) / step - first_row) * passed_stride + (col0 + col) / step -
                  first_col];
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
