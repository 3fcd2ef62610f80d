// The one place where values are rounded and held to an integer type's range.
#pragma once

#include "malus/image/view.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <type_traits>
#include <vector>

namespace malus::internal {

/// As a file's sample type holds it: integers rounded to nearest (ties to even), NaN as 0.
template <class T>
T stored_value(float value) {
  if constexpr (std::is_floating_point_v<T>) {
    return value;
  } else {
    if (std::isnan(value)) return 0;
    constexpr auto kLargest = static_cast<float>(std::numeric_limits<T>::max());
    return static_cast<T>(std::clamp(std::nearbyint(value), 0.0f, kLargest));
  }
}

/// Rows row0 to row1 (exclusive), channel by channel within a pixel.
template <class T>
std::vector<T> interleaved_rows(std::span<const Image> planes, int row0, int row1) {
  std::vector<T> values;
  const int cols = planes[0].cols();
  values.reserve(planes.size() * static_cast<std::size_t>(cols) *
                 static_cast<std::size_t>(row1 - row0));
  for (int r = row0; r < row1; ++r)
    for (int c = 0; c < cols; ++c)
      for (const Image& plane : planes) values.push_back(stored_value<T>(plane(r, c)));
  return values;
}

}  // namespace malus::internal
