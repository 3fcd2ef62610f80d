// The Tukey-lambda distribution of read noise (000 Eq. 3; Hastings et al., Ann. Math. Statist. 18,
// 1947; Joiner and Rosenblatt, JASA 66, 1971). Location 0, scale 1; multiply by sigma_TL and add mu
// for DN. Symmetric; bounded by ±1/λ for λ > 0; logistic at 0, near Gaussian at 0.14, uniform at 1
// and 2.
#pragma once

#include "malus/base/host_device.h"

#if !defined(__CUDACC__)
#include <cmath>
#endif

namespace malus {

/// λ of a law as good as normal: its quantiles are a Gaussian's within 0.4 % to 2.5 deviations and
/// 1.1 % nearer at 3.
inline constexpr double kNormalLambda = 0.14;

/// Below this |λ| the quantile is that of λ = 0 with its first-order term, exact to |λ|² ln²u.
inline constexpr double kTukeyLambdaSeries = 1e-12;

/// Q(u) = (u^λ - (1-u)^λ)/λ, the logistic log(u/(1-u)) at λ = 0. u in (0,1). expm1 keeps what the
/// powers would cancel for small λ: relative error < 1e-14 away from the median, for λ in [-1/2,
/// 8], of which a sampler takes all but -1/2 (physics.h).
MALUS_HOST_DEVICE inline double tukey_lambda_quantile(double u, double lambda) {
  const double a = log(u), b = log1p(-u);
  if (fabs(lambda) < kTukeyLambdaSeries) return (a - b) * (1.0 + 0.5 * lambda * (a + b));
  return (expm1(lambda * a) - expm1(lambda * b)) / lambda;
}

/// Variance for scale 1: 2/λ² (1/(1+2λ) - Γ(λ+1)²/Γ(2λ+2)); π²/3 at λ = 0. Infinite for λ <= -1/2.
/// Relative error < 1e-12.
double tukey_lambda_variance(double lambda);

/// Standard deviation for this scale: of σ_TL in DN the read noise in DN.
double tukey_lambda_deviation(double scale, double lambda);

/// Probability below x for scale 1: Newton on the quantile, guarded by bisection. Error < 1e-12,
/// relative in the lower tail (beyond what the rounding of x causes), absolute in the upper.
double tukey_lambda_cdf(double x, double lambda);

/// Density at x for scale 1: 1 / Q'(F(x)); 0 outside the support.
double tukey_lambda_pdf(double x, double lambda);

}  // namespace malus
