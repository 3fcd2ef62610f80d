// The Tukey-lambda distribution of read noise (000 Eq. 3; Hastings et al., Ann. Math. Statist. 18,
// 1947; Joiner and Rosenblatt, JASA 66, 1971). Location 0, scale 1; multiply by sigma_TL and add mu
// for DN.
#pragma once

#include "malus/base/random.h"

#if !defined(__CUDACC__)
#include <cmath>
#endif

namespace malus {

/// Below this |lambda| the closed form loses more digits to cancellation than the series does to
/// truncation.
inline constexpr double kTukeyLambdaSeries = 1e-6;

/// Q(u) = (u^λ - (1-u)^λ)/λ, the logistic log(u/(1-u)) at λ = 0. u in (0,1).
MALUS_HOST_DEVICE inline double tukey_lambda_quantile(double u, double lambda) {
  const double a = log(u), b = log1p(-u);
  if (fabs(lambda) < kTukeyLambdaSeries) return (a - b) * (1.0 + 0.5 * lambda * (a + b));
  return (expm1(lambda * a) - expm1(lambda * b)) / lambda;
}

/// Variance for scale 1: 2/λ² (1/(1+2λ) - Γ(λ+1)²/Γ(2λ+2)); π²/3 at λ = 0. Infinite for λ <= -1/2.
double tukey_lambda_variance(double lambda);

/// Probability below x for scale 1, by Newton on the quantile with bisection as a guard; |error| <
/// 1e-12.
double tukey_lambda_cdf(double x, double lambda);

}  // namespace malus
