#include "malus/cuda/internal/draw_plan.h"

#include "malus/base/error.h"

#include <algorithm>

namespace malus::cuda {
namespace {

DrawKernel kernel_for(const CompiledParts& parts) {
  if (kGroupColumns / 2 % parts.layout.cols() != 0) return DrawKernel::kAny;
  const bool steps = parts.quantization_dn > 0, read = parts.read_lines != nullptr;
  if (parts.shot == ShotKind::kPoisson && read)
    return steps ? DrawKernel::kPoissonSteps : DrawKernel::kPoisson;
  if (parts.shot == ShotKind::kGaussian && !read)
    return steps ? DrawKernel::kGaussianSteps : DrawKernel::kGaussian;
  return DrawKernel::kAny;
}

// Enough that a thread's preparations are shared by many pixels, and few enough that small frames
// still fill a device: some hundred thousand threads.
int rows_per_thread_for(int rows, unsigned across) {
  constexpr double kThreads = 1 << 18;
  return std::clamp(static_cast<int>(static_cast<double>(across) * rows / kThreads), 1, 64);
}

unsigned ceiling(unsigned a, unsigned b) { return (a + b - 1) / b; }

}  // namespace

DrawPlan plan_draw(const CompiledParts& parts, const float* in, std::ptrdiff_t in_stride,
                   float* out, std::ptrdiff_t out_stride, int rows, int cols,
                   const DrawAddress& address) {
  MALUS_REQUIRE(rows > 0 && cols > 0 && address.row0 >= 0 && address.col0 >= 0);
  const int cell_rows = parts.layout.rows(), cell_cols = parts.layout.cols();
  const int rows_apart = cell_rows * std::max(1, 4 / cell_rows);
  const auto threads_y = static_cast<unsigned>(rows_apart);
  const unsigned threads_x = rows_apart <= 4 ? kThreadsMost / 4 : kThreadsMost / 8;
  const int groups = (address.col0 + cols - 1) / kGroupColumns - address.col0 / kGroupColumns + 1;
  const unsigned across = static_cast<unsigned>(groups) * kGroupColumns / 2;
  const int rows_per_thread = rows_per_thread_for(rows, across);
  const unsigned rows_per_block = threads_y * static_cast<unsigned>(rows_per_thread);

  DrawPlan plan{.frame = {in, out, in_stride, out_stride, rows, cols, address.row0, address.col0,
                          cell_rows, cell_cols, rows_per_thread, rows_apart, rows_apart * in_stride,
                          rows_apart * out_stride, address.frame, philox_keys(address.seed)},
                .grid = {threads_x, threads_y, ceiling(across, threads_x),
                         ceiling(static_cast<unsigned>(rows), rows_per_block)},
                .kernel = kernel_for(parts),
                .row_deviate = std::vector<float>(static_cast<std::size_t>(rows), 0.0f)};
  if (parts.row_noise) {
    const std::vector<double> z = row_deviates(address, rows, parts.row_group, parts.row_drift);
    for (std::size_t r = 0; r < z.size(); ++r) plan.row_deviate[r] = static_cast<float>(z[r]);
  }
  return plan;
}

}  // namespace malus::cuda
