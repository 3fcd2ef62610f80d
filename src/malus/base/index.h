// Signed numbers count rows, columns and channels; containers are indexed by unsigned ones.
#pragma once

#include <cstddef>

namespace malus {

/// Contract: i >= 0.
constexpr std::size_t as_index(std::ptrdiff_t i) { return static_cast<std::size_t>(i); }

}  // namespace malus
