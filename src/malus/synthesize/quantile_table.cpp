#include "malus/synthesize/quantile_table.h"

#include "malus/base/random.h"

#include <bit>
#include <cstddef>

namespace malus {
namespace {

// First x of a cell; x of the words before 1/2 does not occur.
double cell_start(int cell) {
  return static_cast<double>(
      std::bit_cast<float>((kTailFirst + static_cast<std::uint32_t>(cell)) << kTailShift));
}

}  // namespace

std::vector<TailLine> tail_lines(const std::function<double(double p)>& upper_quantile) {
  std::vector<TailLine> lines(static_cast<std::size_t>(kTailCells));
  double left = upper_quantile(cell_start(0) * 0x1p-32);
  for (int cell = 0; cell < kTailCells - 1; ++cell) {
    const double x0 = cell_start(cell), x1 = cell_start(cell + 1);
    const double right = upper_quantile(x1 * 0x1p-32);
    const double middle = upper_quantile(0.5 * (x0 + x1) * 0x1p-32);
    // Mean-square projection of the parabola through the three points: its slope is the chord's,
    // its middle lies a third of the way from the curve to the chord.
    const double slope = (right - left) / (x1 - x0);
    const double centre = middle + (0.5 * (left + right) - middle) / 3.0;
    lines[static_cast<std::size_t>(cell)] = {static_cast<float>(centre - slope * 0.5 * (x0 + x1)),
                                             static_cast<float>(slope)};
    left = right;
  }
  lines.back() = {static_cast<float>(upper_quantile(0.5)), 0.0f};
  return lines;
}

const std::vector<TailLine>& normal_tail_lines() {
  static const std::vector<TailLine> lines =
      tail_lines([](double p) { return -normal_quantile(p); });
  return lines;
}

}  // namespace malus
