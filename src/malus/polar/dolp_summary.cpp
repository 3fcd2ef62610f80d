#include "malus/polar/dolp_summary.h"

#include <algorithm>
#include <cmath>

namespace malus {

DolpSummary summarize_dolp(const Planes& dolp) {
  double sum = 0;
  std::size_t defined = 0, unpolarized = 0, above_one = 0, all = 0;
  for (const Image& plane : dolp)
    for (const float v : plane.values()) {
      ++all;
      if (!std::isfinite(v)) continue;
      sum += std::min(v, 1.0f);
      unpolarized += v == 0.0f;
      above_one += v > 1.0f;
      ++defined;
    }
  DolpSummary summary;
  if (defined > 0)
    summary.mean = sum / static_cast<double>(defined);
  else
    summary.mean = Undecided{"no pixel has light"};
  const auto share = [all](std::size_t pixels) {
    return all > 0 ? static_cast<double>(pixels) / static_cast<double>(all) : 0.0;
  };
  summary.undefined = share(all - defined);
  summary.aolp_undefined = share(all - defined + unpolarized);
  summary.above_one = share(above_one);
  return summary;
}

}  // namespace malus
