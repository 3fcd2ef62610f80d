// A channel's light as a polynomial of the place.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/image/view.h"

#include <vector>

namespace malus {

// A channel's light as a polynomial of the place, of terms that are orthonormal over the channel.
struct LightPolynomial {
  std::vector<std::vector<double>> down, right;  // [degree][at]
  std::vector<double> coefficients;              // [down][right]; 0: no term

  double& term(std::size_t i, std::size_t j) { return coefficients[i * right.size() + j]; }
  double term(std::size_t i, std::size_t j) const { return coefficients[i * right.size() + j]; }
  // Whether a channel's light is always taken to have this term.
  bool low(std::size_t i, std::size_t j) const;
  bool has_high() const;
};

// kHigh: and of the terms of further degrees those that stand out of noise (a cosine, a spot).
// Defects would pull at them: they must be known before.
enum class LightDegree { kLow, kHigh };

// Fitted by least squares to the channel's values, whose place its own then take.
LightPolynomial fit_light(const MosaicGeometry& geometry, int channel, LightDegree degree,
                          Image& light);

}  // namespace malus
