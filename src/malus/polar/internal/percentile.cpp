#include "malus/polar/internal/percentile.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace malus::internal {

double percentile(std::vector<float> values, double percent) {
  std::erase_if(values, [](float v) { return !std::isfinite(v); });
  if (values.empty()) return 0;
  const auto rank = static_cast<std::ptrdiff_t>(std::min(percent / 100, 1.0) *
                                                static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + rank, values.end());
  return values[static_cast<std::size_t>(rank)];
}

}  // namespace malus::internal
