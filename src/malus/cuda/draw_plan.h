// What one launch of the drawing kernel is given: plain host code, so that tests can run the
// kernel's device code on a CPU.
#pragma once

#include "malus/synthesize/compiled.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace malus::cuda {

/// The kernel's first argument. Pointers are the device's, strides count elements.
struct DrawFrame {
  const float* in;
  float* out;
  std::ptrdiff_t in_stride, out_stride;
  int rows, cols, row0, col0;
  int cell_rows, cell_cols;
  std::uint64_t seed;
  std::uint32_t frame;
};

/// Threads of a block and blocks of the grid, along columns (x) and rows (y).
struct DrawGrid {
  unsigned threads_x, threads_y, blocks_x, blocks_y;
};

struct DrawPlan {
  DrawFrame frame;
  DrawGrid grid;
  std::vector<float> row_deviate;  ///< of every row, in deviations; zeros without row noise
};

/// One thread per Philox block of a row: it draws columns j and j + 16 of a group of 32. Contract:
/// rows and cols > 0, the address not negative.
DrawPlan plan_draw(const CompiledParts& parts, const float* in, std::ptrdiff_t in_stride,
                   float* out, std::ptrdiff_t out_stride, int rows, int cols,
                   const DrawAddress& address);

}  // namespace malus::cuda
