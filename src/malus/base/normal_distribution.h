// The standard normal distribution.
#pragma once

#include <cmath>
#include <numbers>

namespace malus {

inline double normal_density(double z) {
  return std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
}

/// Probability below z.
inline double normal_cdf(double z) { return 0.5 * std::erfc(-z / std::numbers::sqrt2); }

/// E max(0, z + n) of a standard normal deviate n: the distribution's integral up to z.
inline double mean_above_zero(double z) { return z * normal_cdf(z) + normal_density(z); }

}  // namespace malus
