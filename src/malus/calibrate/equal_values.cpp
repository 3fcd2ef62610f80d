#include "malus/calibrate/internal/equal_values.h"

#include "malus/base/index.h"

#include <cmath>
#include <numbers>

namespace malus {
namespace {

// Chance that two values with normal noise of this deviation, in codes, have one code, wherever in
// a code their mean lies: the mean of 1 - |d| where the difference d is below 1.
double equal_pair(double sd_codes) {
  const double t = 1.0 / (2.0 * sd_codes);  // 1 over √2 times the difference's deviation
  return std::erf(t) - (1.0 - std::exp(-t * t)) / (t * std::sqrt(std::numbers::pi));
}

}  // namespace

double chance_to_stay(double chance_of_equal_pair) {
  double narrow = 1e-3, wide = 1e3;
  for (int i = 0; i < 60; ++i) {
    const double middle = std::sqrt(narrow * wide);
    (equal_pair(middle) > chance_of_equal_pair ? narrow : wide) = middle;
  }
  return std::erf(0.5 / (narrow * std::numbers::sqrt2));
}

EqualValues::EqualValues(const MosaicGeometry& geometry)
    : geometry_(geometry), equal_(as_index(geometry.channels()), 0.0) {}

void EqualValues::add(View<const float> dn) {
  if (frames_++ == 0) previous_ = Image(dn.rows(), dn.cols());
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c) {
      if (frames_ > 1 && dn(r, c) == previous_(r, c))
        equal_[as_index(geometry_.channel(r, c))] += 1.0;
      previous_(r, c) = dn(r, c);
    }
}

std::vector<double> EqualValues::chance_of_constancy() const {
  std::vector<double> chance(equal_.size(), 1.0);
  for (int c = 0; c < geometry_.channels() && frames_ > 1; ++c) {
    const double pairs = static_cast<double>(geometry_.channel_pixels(c)) * (frames_ - 1);
    chance[as_index(c)] = std::pow(chance_to_stay(equal_[as_index(c)] / pairs), frames_ - 1);
  }
  return chance;
}

}  // namespace malus
