// One of several, drawn evenly.
#pragma once

#include "malus/base/random.h"

#include <algorithm>
#include <cstddef>

namespace malus {

/// A number from 0 to count - 1; uses one draw of the sequence. Contract: count > 0.
inline std::size_t pick(RandomSequence& random, std::size_t count) {
  return std::min(count - 1,
                  static_cast<std::size_t>(random.uniform() * static_cast<double>(count)));
}

}  // namespace malus
