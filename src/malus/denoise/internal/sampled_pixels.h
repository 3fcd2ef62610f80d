// Pixels spread over a frame, where all of them would tell no more.
#pragma once

#include "malus/image/view.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace malus::internal {

/// visit(row, col) for about `most` pixels, or all of fewer: of as many equal pieces of the frame,
/// one pixel each, at a place that follows no pattern. Steps of one length would keep to some rows
/// and columns of a cell, as 1225 does to those of 8x8 in a frame of 2448 columns.
template <class Visit>
void for_each_sampled(View<const float> dn, std::size_t most, const Visit& visit) {
  constexpr std::uint64_t kGolden = 0x9E3779B97F4A7C15;  // Knuth's multiplicative hash
  const auto cols = static_cast<std::size_t>(dn.cols()),
             size = static_cast<std::size_t>(dn.rows()) * cols;
  const std::size_t piece = std::max<std::size_t>(size / most, 1);
  for (std::size_t begin = 0, k = 0; begin < size; begin += piece, ++k) {
    const std::size_t i = std::min(begin + (k * kGolden >> 32) % piece, size - 1);
    visit(static_cast<int>(i / cols), static_cast<int>(i % cols));
  }
}

}  // namespace malus::internal
