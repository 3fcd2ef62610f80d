#include "malus/image/middle.h"

#include <algorithm>
#include <numeric>

namespace malus {

Image middle_of(const Image& mosaic, const SensorLayout& layout, int side) {
  const int cell = std::lcm(std::lcm(layout.rows(), layout.cols()), 2);
  const auto length = [&](int size) { return std::min(size, side) / cell * cell; };
  const int rows = length(mosaic.rows()), cols = length(mosaic.cols());
  const int row0 = (mosaic.rows() - rows) / 2 / cell * cell;
  const int col0 = (mosaic.cols() - cols) / 2 / cell * cell;
  Image middle(rows, cols);
  for (int r = 0; r < rows; ++r) std::copy_n(mosaic.row(row0 + r) + col0, cols, middle.row(r));
  return middle;
}

}  // namespace malus
