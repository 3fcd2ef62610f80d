// How quickly the examples that a training draws from change (example_pool.h).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace malus {

struct Refresh {
  double per_step = 0;          ///< new examples per place and step; 0: measured until `from`
  std::int64_t from = 0;        ///< at this step
  std::int64_t generation = 0;  ///< this one is the newest
  /// Generation at a step.
  std::int64_t newest(std::int64_t step) const {
    const auto counted = static_cast<double>(std::max<std::int64_t>(0, step - from));
    return generation + static_cast<std::int64_t>(std::floor(counted * per_step));
  }
};

/// Generations made before they are needed, beside the pool. With one, makers that find no place
/// left in it wait for the slowest of its examples.
inline constexpr int kGenerationsAhead = 2;

}  // namespace malus
