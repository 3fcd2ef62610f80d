// Expectations over a pixel's whole distribution, which samplers and approximations are tested
// against.
#pragma once

#include "malus/noise/distribution.h"

#include <cstddef>

namespace malus::testing {

/// E f(D) for f smooth on the scale of the read noise.
template <class Function>
double expectation_of(const Function& f, const PixelDistribution& pixel) {
  double sum = 0;
  for (std::size_t i = 0; i < pixel.levels_dn().size(); ++i) {
    double part = 0;
    for (const auto& node : pixel.read().nodes())
      part += node.weight * f(pixel.levels_dn()[i] + node.x_dn);
    sum += pixel.probabilities()[i] * part;
  }
  return sum;
}

}  // namespace malus::testing
