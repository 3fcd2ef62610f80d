#include "malus/noise/rounding.h"

#include <cmath>
#include <numbers>

namespace malus {

double undithered_variance(double step_dn, double variance_dn2) {
  if (!(step_dn > 0)) return 0;
  constexpr double kPi2 = std::numbers::pi * std::numbers::pi;
  const double noise = variance_dn2 / (step_dn * step_dn);
  constexpr double kNoNoise = 1e-4;  // whose sum has the closed form
  if (noise < kNoNoise) return step_dn * step_dn / 12;
  double sum = 0;
  for (int k = 1; k < 64; ++k) {
    const double exponent = 4 * kPi2 * k * k * noise;
    if (exponent > 40) break;
    sum += std::exp(-exponent) / (2 * kPi2 * k * k);
  }
  return step_dn * step_dn * sum;
}

}  // namespace malus
