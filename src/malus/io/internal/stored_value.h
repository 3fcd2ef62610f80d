// The one place where values are rounded and held to an integer type's range.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

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

}  // namespace malus::internal
