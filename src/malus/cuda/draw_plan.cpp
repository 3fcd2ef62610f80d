#include "malus/cuda/draw_plan.h"

#include "malus/base/error.h"

namespace malus::cuda {

DrawPlan plan_draw(const CompiledParts& parts, const float* in, std::ptrdiff_t in_stride,
                   float* out, std::ptrdiff_t out_stride, int rows, int cols,
                   const DrawAddress& address) {
  MALUS_REQUIRE(rows > 0 && cols > 0 && address.row0 >= 0 && address.col0 >= 0);
  constexpr unsigned kThreadsX = 64, kThreadsY = 4;
  const int groups = (address.col0 + cols - 1) / kGroupColumns - address.col0 / kGroupColumns + 1;
  const unsigned across = static_cast<unsigned>(groups) * kGroupColumns / 2;
  const unsigned down = static_cast<unsigned>(rows);

  DrawPlan plan{.frame = {in, out, in_stride, out_stride, rows, cols, address.row0, address.col0,
                          parts.layout.rows(), parts.layout.cols(), address.seed, address.frame},
                .grid = {kThreadsX, kThreadsY, (across + kThreadsX - 1) / kThreadsX,
                         (down + kThreadsY - 1) / kThreadsY},
                .row_deviate = std::vector<float>(static_cast<std::size_t>(rows), 0.0f)};
  if (parts.row_noise) {
    const std::vector<double> z = row_deviates(address, rows, parts.row_group, parts.row_drift);
    for (std::size_t r = 0; r < z.size(); ++r) plan.row_deviate[r] = static_cast<float>(z[r]);
  }
  return plan;
}

}  // namespace malus::cuda
