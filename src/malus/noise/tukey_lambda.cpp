#include "malus/noise/tukey_lambda.h"

#include "malus/base/log_gamma.h"

#include <algorithm>
#include <array>
#include <limits>

namespace malus {
namespace {

// ζ(2) ... ζ(15)
constexpr std::array<double, 14> kZeta = {
    1.6449340668482264, 1.2020569031595943, 1.0823232337111382, 1.0369277551433700,
    1.0173430619844491, 1.0083492773819228, 1.0040773561979443, 1.0020083928260822,
    1.0009945751278181, 1.0004941886041195, 1.0002460865533080, 1.0001227133475785,
    1.0000612481350587, 1.0000305882363070};

// g(λ)/λ² with g = 2 lnΓ(1+λ) - lnΓ(1+2λ): from lnΓ(1+x) = -γx + Σ ζ(k)(-x)^k/k the terms in λ
// cancel and the rest is Σ_{k>=2} ζ(k) (2 - 2^k)/k (-1)^k λ^(k-2). For |λ| < 0.05 the first term
// left out is below 1e-13 of the sum.
double gamma_ratio_series(double lambda) {
  double sum = 0, power = 1;
  for (int k = 2; k < 2 + static_cast<int>(kZeta.size()); ++k) {
    sum += kZeta[static_cast<std::size_t>(k) - 2] * (2.0 - std::ldexp(1.0, k)) / k * power;
    power *= -lambda;
  }
  return sum;
}

// dQ/du = u^(λ-1) + (1-u)^(λ-1)
double quantile_slope(double u, double lambda) {
  return std::pow(u, lambda - 1.0) + std::pow(1.0 - u, lambda - 1.0);
}

// Where the tail's leading term u^λ = 1 + λx puts x <= 0.
double lower_tail_guess(double x, double lambda) {
  const double u = std::abs(lambda) < 1e-8 ? std::exp(x) : std::pow(1.0 + lambda * x, 1.0 / lambda);
  return std::clamp(u, std::numeric_limits<double>::min(), 0.5);
}

// F(x) for x <= 0.
double lower_cdf(double x, double lambda) {
  if (lambda > 0 && x <= -1.0 / lambda) return 0.0;
  double low = 0.0, high = 0.5, u = lower_tail_guess(x, lambda);
  for (int i = 0; i < 100; ++i) {
    const double error = tukey_lambda_quantile(u, lambda) - x;
    (error > 0 ? high : low) = u;
    double next = u - error / quantile_slope(u, lambda);
    // Tails span many decades: the guard halves the exponent, not the interval.
    if (!(next > low && next < high)) next = low > 0 ? std::sqrt(low * high) : 0.1 * high;
    if (std::abs(next - u) <= 4e-16 * u) return next;
    u = next;
  }
  return u;
}

}  // namespace

double tukey_lambda_variance(double lambda) {
  if (lambda <= -0.5) return std::numeric_limits<double>::infinity();
  constexpr double kSeriesBelow = 0.05;
  const double lambda2 = lambda * lambda;
  const double g = std::abs(lambda) < kSeriesBelow
                       ? gamma_ratio_series(lambda) * lambda2
                       : 2.0 * log_gamma(1.0 + lambda) - log_gamma(1.0 + 2.0 * lambda);
  // Γ(2λ+2) = (1+2λ) Γ(1+2λ), so the variance is 2 (1 - e^g) / (λ² (1+2λ)).
  const double one_minus_ratio =
      std::abs(lambda) < 1e-100 ? -gamma_ratio_series(lambda) : -std::expm1(g) / lambda2;
  return 2.0 * one_minus_ratio / (1.0 + 2.0 * lambda);
}

double tukey_lambda_deviation(double scale, double lambda) {
  return scale * std::sqrt(tukey_lambda_variance(lambda));
}

double tukey_lambda_cdf(double x, double lambda) {
  return x > 0 ? 1.0 - lower_cdf(-x, lambda) : lower_cdf(x, lambda);
}

double tukey_lambda_pdf(double x, double lambda) {
  if (lambda > 0 && std::abs(x) > 1.0 / lambda) return 0.0;
  return 1.0 / quantile_slope(lower_cdf(-std::abs(x), lambda), lambda);
}

}  // namespace malus
