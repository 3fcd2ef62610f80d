// Minimum of a function of one variable by golden sections.
#pragma once

namespace malus {

/// Where the only minimum of `of` between low and high lies, to 0.618^sections of the distance.
template <class Function>
double golden_section_minimum(const Function& of, double low, double high, int sections) {
  constexpr double kGolden = 0.6180339887498949;
  double a = high - kGolden * (high - low), b = low + kGolden * (high - low);
  double at_a = of(a), at_b = of(b);
  for (int i = 0; i < sections; ++i) {
    if (at_a <= at_b) {
      high = b, b = a, at_b = at_a;
      at_a = of(a = high - kGolden * (high - low));
    } else {
      low = a, a = b, at_a = at_b;
      at_b = of(b = low + kGolden * (high - low));
    }
  }
  return 0.5 * (low + high);
}

}  // namespace malus
