#include "malus/image/window.h"

#include <algorithm>

namespace malus {

Image copy_of(View<const float> from) {
  Image copy(from.rows(), from.cols());
  for (int r = 0; r < from.rows(); ++r) std::copy_n(from.row(r), from.cols(), copy.row(r));
  return copy;
}

Image part_of(View<const float> mosaic, const MosaicWindow& window) {
  return copy_of(mosaic.window(window.row0, window.col0, window.rows, window.cols));
}

}  // namespace malus
