// What one launch of the drawing kernel is given: plain host code, so that tests can run the
// kernel's device code on a CPU.
#pragma once

#include "malus/synthesize/compiled.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace malus::cuda {

/// draw_noise is compiled for the usual noise models, whose switches then cost nothing, and once
/// for all others: any switches, any cell.
enum class DrawKernel { kAny, kPoissonSteps, kPoisson, kGaussianSteps, kGaussian };

/// Threads of a block at most.
inline constexpr unsigned kThreadsMost = 256;

/// The kernel's first argument. Pointers are the device's, strides count elements.
struct DrawFrame {
  const float* in;
  float* out;
  std::ptrdiff_t in_stride, out_stride;
  int rows, cols, row0, col0;
  int cell_rows, cell_cols;
  int rows_per_thread;               ///< at most
  int rows_apart;                    ///< so far does a thread's next row lie from its last,
  std::ptrdiff_t in_step, out_step;  ///< and so far in elements
  std::uint32_t frame;
  PhiloxKeys keys;
};

/// Threads of a block and blocks of the grid, along columns (x) and rows (y).
struct DrawGrid {
  unsigned threads_x, threads_y, blocks_x, blocks_y;
};

struct DrawPlan {
  DrawFrame frame;
  DrawGrid grid;
  DrawKernel kernel = DrawKernel::kAny;
  std::vector<float> row_deviate;  ///< of every row, in deviations; zeros without row noise
};

/// One thread per Philox block of a row, which draws columns j and j + 16 of a group of 32, in
/// several rows that lie threads_y apart, a multiple of the cell's rows: they share a channel.
/// Contract: rows and cols > 0, the address not negative.
DrawPlan plan_draw(const CompiledParts& parts, const float* in, std::ptrdiff_t in_stride,
                   float* out, std::ptrdiff_t out_stride, int rows, int cols,
                   const DrawAddress& address);

}  // namespace malus::cuda
