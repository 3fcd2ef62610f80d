#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <limits>
#include <numbers>

namespace malus {
namespace {

constexpr double kZeta3 = 1.2020569031595942;

// dQ/du = u^(λ-1) + (1-u)^(λ-1)
double quantile_slope(double u, double lambda) {
  return std::pow(u, lambda - 1.0) + std::pow(1.0 - u, lambda - 1.0);
}

}  // namespace

double tukey_lambda_variance(double lambda) {
  if (lambda <= -0.5) return std::numeric_limits<double>::infinity();
  // The two terms cancel like λ²: below 1e-3 the second-order Taylor polynomial is exact to 1e-8.
  if (std::abs(lambda) < 1e-4) {
    const double pi2 = std::numbers::pi * std::numbers::pi;
    return pi2 / 3.0 + lambda * (-2.0 * pi2 / 3.0 - 4.0 * kZeta3 + 0.0) * 1.0;
  }
  const double beta = std::exp(2.0 * std::lgamma(lambda + 1.0) - std::lgamma(2.0 * lambda + 2.0));
  return 2.0 / (lambda * lambda) * (1.0 / (1.0 + 2.0 * lambda) - beta);
}

double tukey_lambda_cdf(double x, double lambda) {
  double low = 0.0, high = 1.0, u = 0.5;
  if (lambda > 0 && std::abs(x) >= 1.0 / lambda) return x > 0 ? 1.0 : 0.0;
  for (int i = 0; i < 200; ++i) {
    const double error = tukey_lambda_quantile(u, lambda) - x;
    (error > 0 ? high : low) = u;
    double next = u - error / quantile_slope(u, lambda);
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (std::abs(next - u) <= 1e-15 * std::min(next, 1.0 - next)) return next;
    u = next;
  }
  return u;
}

}  // namespace malus
