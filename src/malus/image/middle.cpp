#include "malus/image/middle.h"

#include <algorithm>
#include <numeric>

namespace malus {

MosaicWindow middle_window(int rows, int cols, const SensorLayout& layout, int side,
                           int row_group) {
  const int cell = std::lcm(std::lcm(layout.rows(), layout.cols()), 2);
  const auto length = [&](int size, int step) { return std::min(size, side) / step * step; };
  const auto start = [](int size, int part, int step) { return (size - part) / 2 / step * step; };
  const int group = std::lcm(cell, row_group);
  MosaicWindow window{.rows = length(rows, group), .cols = length(cols, cell)};
  window.row0 = start(rows, window.rows, group);
  window.col0 = start(cols, window.cols, cell);
  return window;
}

Image middle_of(const Image& mosaic, const SensorLayout& layout, int side) {
  return part_of(mosaic, middle_window(mosaic.rows(), mosaic.cols(), layout, side));
}

}  // namespace malus
