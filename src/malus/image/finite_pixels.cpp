#include "malus/image/finite_pixels.h"

#include <algorithm>
#include <cmath>

namespace malus {

double finite_mean(View<const float> pixels) {
  double sum = 0, count = 0;
  for (int r = 0; r < pixels.rows(); ++r)
    for (int c = 0; c < pixels.cols(); ++c)
      if (std::isfinite(pixels(r, c))) {
        sum += double{pixels(r, c)};
        ++count;
      }
  return count > 0 ? sum / count : 0.0;
}

double finite_largest(View<const float> pixels) {
  float largest = 0;
  for (int r = 0; r < pixels.rows(); ++r)
    for (int c = 0; c < pixels.cols(); ++c)
      if (std::isfinite(pixels(r, c))) largest = std::max(largest, pixels(r, c));
  return double{largest};
}

}  // namespace malus
