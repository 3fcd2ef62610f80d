// Pixels spread over a frame, where all of them would tell no more.
#pragma once

#include "malus/image/view.h"

#include <algorithm>

namespace malus::internal {

/// visit(row, col) for about `most` pixels or all of fewer, an odd number of pixels apart: of all
/// channels of a layout, whose periods are powers of two.
template <class Visit>
void for_each_sampled(View<const float> dn, std::size_t most, const Visit& visit) {
  const auto cols = static_cast<std::size_t>(dn.cols()),
             size = static_cast<std::size_t>(dn.rows()) * cols;
  const std::size_t step = std::max<std::size_t>(size / most, 1) | 1;
  for (std::size_t i = 0; i < size; i += step)
    visit(static_cast<int>(i / cols), static_cast<int>(i % cols));
}

}  // namespace malus::internal
