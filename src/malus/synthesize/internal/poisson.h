// Exact Poisson draws from a stream of uniforms: the shot noise of the plain definition (000 Eq.
// 2). Below a mean of 10 by inversion, one uniform; above by Hoermann's transformed rejection PTRS
// ("The transformed rejection method for generating Poisson random variables", Insurance:
// Mathematics and Economics 12, 1993), 2.3 uniforms on average. The same source serves CPU and GPU.
#pragma once

#include "malus/base/host_device.h"
#include "malus/base/log_gamma.h"

#if !defined(__CUDACC__)
#include <cmath>
#endif

namespace malus {

inline constexpr double kPoissonInversionBelow = 10.0;

/// A Poisson deviate as a whole number in a double. mean: finite, 0 <= mean <= 1e12.
/// uniforms() gives independent doubles in the open interval (0,1).
template <class Uniforms>
MALUS_HOST_DEVICE double poisson_draw(double mean, Uniforms& uniforms) {
  if (mean <= 0.0) return 0.0;
  if (mean < kPoissonInversionBelow) {
    double left = uniforms(), probability = exp(-mean), count = 0.0;
    // The largest uniform is 1 - 2^-53: rounding could otherwise leave a remainder that no term
    // covers, so the sum ends where terms stop changing it.
    while (left > probability && probability > 0x1p-80) {
      left -= probability;
      count += 1.0;
      probability *= mean / count;
    }
    return count;
  }
  const double b = 0.931 + 2.53 * sqrt(mean);
  const double a = -0.059 + 0.02483 * b;
  const double inverse_alpha = 1.1239 + 1.1328 / (b - 3.4);
  const double squeeze = 0.9277 - 3.6224 / (b - 2.0);
  const double log_mean = log(mean);
  for (;;) {
    const double u = uniforms() - 0.5, v = uniforms();
    const double us = 0.5 - fabs(u);
    const double count = floor((2.0 * a / us + b) * u + mean + 0.43);
    if (us >= 0.07 && v <= squeeze) return count;
    if (count < 0.0 || (us < 0.013 && v > us)) continue;
    if (log(v * inverse_alpha / (a / (us * us) + b)) <=
        -mean + count * log_mean - log_gamma(count + 1.0))
      return count;
  }
}

}  // namespace malus
