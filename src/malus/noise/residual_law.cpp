#include "malus/noise/residual_law.h"

#include "malus/base/error.h"
#include "malus/base/normal_distribution.h"
#include "malus/base/normal_nodes.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace malus {
namespace {

// ∫ F dt from -∞ to x <= 0 for scale 1: by parts x F(x) - ∫ Q dv from 0 to F(x), and
// ∫ Q dv = (u^(λ+1) + (1-u)^(λ+1) - 1) / (λ (λ+1)), u ln u + (1-u) ln(1-u) at λ = 0.
double lower_ramp(double x, double lambda) {
  const double u = tukey_lambda_cdf(x, lambda);
  if (!(u > 0)) return 0;
  const double a = std::log(u), b = std::log1p(-u);
  const double quantiles = std::abs(lambda) < kTukeyLambdaSeries
                               ? u * a + (1 - u) * b
                               : (u * std::expm1(lambda * a) + (1 - u) * std::expm1(lambda * b)) /
                                     (lambda * (lambda + 1));
  return std::max(x * u - quantiles, 0.0);
}

// By symmetry the ramp at x is x more than that at -x.
double tukey_ramp(double x, double lambda) {
  return x > 0 ? x + lower_ramp(-x, lambda) : lower_ramp(x, lambda);
}

}  // namespace

ResidualLaw::ResidualLaw(Ramp ramp, double deviation_dn, const ResidualBlurring& blur)
    : ramp_(std::move(ramp)),
      // Without a step the box is too narrow to be seen.
      half_step_dn_(std::max(0.5 * blur.step_dn, 1e-3 * deviation_dn)),
      offset_deviation_dn_(std::sqrt(std::max(blur.offset_variance_dn2, 0.0))) {}

ResidualLaw ResidualLaw::tukey(double lambda, double scale_dn, const ResidualBlurring& blur) {
  MALUS_REQUIRE(lambda > -0.5 && scale_dn > 0);
  return {[=](double x) { return scale_dn * tukey_ramp(x / scale_dn, lambda); },
          tukey_lambda_deviation(scale_dn, lambda), blur};
}

ResidualLaw ResidualLaw::normal(double deviation_dn, const ResidualBlurring& blur) {
  MALUS_REQUIRE(deviation_dn > 0);
  return {[=](double x) { return deviation_dn * mean_above_zero(x / deviation_dn); }, deviation_dn,
          blur};
}

// The laws are symmetric: what lies above r is what lies below -r, where small values are exact.
double ResidualLaw::above(double r_dn) const {
  if (offset_deviation_dn_ == 0)
    return (ramp_(half_step_dn_ - r_dn) - ramp_(-half_step_dn_ - r_dn)) / (2 * half_step_dn_);
  double probability = 0;
  for (const NormalNode& node : kNormalNodes) {
    const double x = offset_deviation_dn_ * node.at - r_dn;
    probability += node.weight * (ramp_(x + half_step_dn_) - ramp_(x - half_step_dn_));
  }
  return probability / (2 * half_step_dn_);
}

double ResidualLaw::density(double r_dn, double bin_dn) const {
  MALUS_REQUIRE(bin_dn > 0);
  const double r = std::abs(r_dn);  // the upper side, where differences keep their digits
  return (above(r - 0.5 * bin_dn) - above(r + 0.5 * bin_dn)) / bin_dn;
}

}  // namespace malus
