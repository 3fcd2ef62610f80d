// Functions that are given at knots and straight between them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>

namespace malus::internal {

/// y at a given x for rising tables of one length, not empty; the first of equal x, exact at knots.
/// Below and above the table its ends.
inline double table_at(std::span<const double> x, std::span<const double> y, double at) {
  const auto above = std::lower_bound(x.begin(), x.end(), at);
  if (above == x.begin()) return y.front();
  if (above == x.end()) return y.back();
  const auto i = static_cast<std::size_t>(above - x.begin());  // x[i - 1] < at <= x[i]
  return y[i] - (x[i] - at) / (x[i] - x[i - 1]) * (y[i] - y[i - 1]);
}

}  // namespace malus::internal
