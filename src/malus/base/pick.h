// One of several, drawn evenly.
#pragma once

#include "malus/base/random.h"

#include <algorithm>
#include <concepts>

namespace malus {

/// A number from 0 to count - 1; uses one draw of the sequence. Contract: count > 0.
template <std::integral Count>
Count pick(RandomSequence& random, Count count) {
  return std::min<Count>(count - 1,
                         static_cast<Count>(random.uniform() * static_cast<double>(count)));
}

}  // namespace malus
