#include "malus/image/quantization.h"

#include <cmath>
#include <cstdint>
#include <numeric>

namespace malus {

double quantization_step(View<const float> dn) {
  constexpr float kLargest = 4294967296.0F;  // that an integer file holds
  std::int64_t step = 0;
  const float origin = dn(0, 0);
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c) {
      const float difference = dn(r, c) - origin;
      if (!(std::abs(dn(r, c)) <= kLargest)) return 0.0;  // NaN too
      if (difference != std::floor(difference) || dn(r, c) != std::floor(dn(r, c))) return 0.0;
      step = std::gcd(step, static_cast<std::int64_t>(difference));
      if (step == 1) return 1.0;
    }
  return static_cast<double>(step);
}

}  // namespace malus
