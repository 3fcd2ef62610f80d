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

double rounded_variance(double step_dn, double offset_dn, double variance_dn2) {
  const double sd = std::sqrt(variance_dn2) / step_dn,
               beside = std::remainder(offset_dn / step_dn, 1.0);
  const auto below = [&](double code) {  // share of the samples below its upper edge
    return 0.5 * std::erfc((beside - code - 0.5) / (std::sqrt(2.0) * sd));
  };
  const int reach = 1 + static_cast<int>(std::min(8 * sd, 1e4));
  double mean = 0, square = 0;
  for (int code = -reach; code <= reach; ++code) {
    const double share = below(code) - below(code - 1);
    mean += share * code;
    square += share * code * code;
  }
  return (square - mean * mean) * step_dn * step_dn;
}

double most_rounded_noise(double step_dn, double variance_dn2) {
  constexpr int kHalvings = 40;
  double less = 0, more = variance_dn2 + step_dn * step_dn;  // shows more than rounding can hide
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = (less + more) / 2;
    (rounded_variance(step_dn, 0, middle) > variance_dn2 ? more : less) = middle;
  }
  return more;
}

}  // namespace malus
