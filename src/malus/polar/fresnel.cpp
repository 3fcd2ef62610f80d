#include "malus/polar/fresnel.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace malus {
namespace {

double radians(double deg) { return deg * std::numbers::pi / 180; }

// The zenith between two where dolp_of rises (or falls) through dolp; 60 halvings leave 1e-16.
template <class Function>
double bisected_deg(double dolp, double lowest, double highest, Function dolp_of) {
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (lowest + highest);
    (dolp_of(middle) < dolp ? lowest : highest) = middle;
  }
  return 0.5 * (lowest + highest);
}

}  // namespace

double diffuse_dolp(double zenith_deg, double index) {
  const double s2 = std::pow(std::sin(radians(zenith_deg)), 2), n = index;
  const double difference = n - 1 / n, sum = n + 1 / n;
  return difference * difference * s2 /
         (2 + 2 * n * n - sum * sum * s2 +
          4 * std::cos(radians(zenith_deg)) * std::sqrt(n * n - s2));
}

double specular_dolp(double zenith_deg, double index) {
  const double s2 = std::pow(std::sin(radians(zenith_deg)), 2), n2 = index * index;
  return 2 * s2 * std::cos(radians(zenith_deg)) * std::sqrt(n2 - s2) /
         (n2 - s2 - n2 * s2 + 2 * s2 * s2);
}

double brewster_deg(double index) { return std::atan(index) * 180 / std::numbers::pi; }

double zenith_of_diffuse_deg(double dolp, double index) {
  MALUS_REQUIRE(index > 1);
  if (dolp >= diffuse_dolp(90, index)) return 90;
  return bisected_deg(std::max(dolp, 0.0), 0, 90, [&](double z) { return diffuse_dolp(z, index); });
}

double zenith_of_specular_deg(double dolp, double index, BrewsterSide side) {
  MALUS_REQUIRE(index > 1);
  const double held = std::clamp(dolp, 0.0, 1.0), top = brewster_deg(index);
  const double other_end = side == BrewsterSide::kBelow ? 0 : 90;
  return bisected_deg(held, other_end, top, [&](double z) { return specular_dolp(z, index); });
}

}  // namespace malus
