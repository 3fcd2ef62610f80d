#include "malus/calibrate/internal/coarse_steps.h"

#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

namespace malus {
namespace {

// Characteristic function at one cycle per step, and -1 times its derivative there, in steps.
struct LeftOfLaw {
  double left = 0, slope = 0;
};

// Of Tukey-lambda noise: means over its quantiles. Of noise with half its values beyond two steps
// it is of no consequence, and where quantiles lie steps apart their cosines are of chance.
LeftOfLaw coarse_of_tukey_lambda(double lambda, double scale_steps) {
  constexpr int kQuantiles = 4000;
  constexpr double kWideSteps = 2;
  if (scale_steps * tukey_lambda_quantile(0.75, lambda) > kWideSteps) return {};
  LeftOfLaw sum;
  for (int i = 0; i < kQuantiles; ++i) {
    const double x = scale_steps * tukey_lambda_quantile((i + 0.5) / kQuantiles, lambda);
    sum.left += std::cos(2.0 * std::numbers::pi * x);
    sum.slope += x * std::sin(2.0 * std::numbers::pi * x);
  }
  return {std::abs(sum.left) / kQuantiles, std::abs(sum.slope) / kQuantiles};
}

double coarse_of_normal(double sd_steps) {
  return std::exp(-2.0 * std::numbers::pi * std::numbers::pi * sd_steps * sd_steps);
}

void widen_lines(double slope, std::size_t c, ChannelStatistics& lines) {
  lines.standard_error[c] = std::hypot(lines.standard_error[c], slope * lines.mean[c]);
}

}  // namespace

void warn_of_coarse_steps(double quantization_dn, PhysicsCalibration& out) {
  const auto constant = [](double sd) { return sd == 0; };
  if (std::all_of(out.temporal_sd_dark_dn.begin(), out.temporal_sd_dark_dn.end(), constant)) {
    out.warnings.push_back(
        "all dark pixels keep their value: the noise is too narrow for the converter's step, and "
        "its parameters are not known");
    return;
  }
  if (!(quantization_dn > 0)) return;
  double most = 0, narrowest_dn = 0;
  for (std::size_t c = 0; c < out.temporal_sd_dark_dn.size(); ++c) {
    const bool shape_known = c < out.sigma_tl.mean.size() && std::isfinite(out.sigma_tl.mean[c]);
    const double left =
        shape_known
            ? coarse_of_tukey_lambda(out.lambda.mean[c], out.sigma_tl.mean[c] / quantization_dn)
                      .left *
                  coarse_of_normal(out.sigma_row.mean[c] / quantization_dn)
            : coarse_of_normal(out.temporal_sd_dark_dn[c] / quantization_dn);
    if (left > most) narrowest_dn = out.temporal_sd_dark_dn[c];
    most = std::max(most, left);
  }
  if (most > coarse_of_normal(0.5))
    out.warnings.push_back(fmt::format(
        "the dark noise, {:.2g} DN, is too narrow for the converter's step, {:g} DN: "
        "rounding hides its parameters, and the standard errors of σ_TL and λ are too small",
        narrowest_dn, quantization_dn));
}

// At the place o of a code, in steps, rounding makes of noise with the characteristic function φ a
// mean that rises by 1 - 2 φ cos 2πo with o, and adds to its variance, beside 1/12, at most
// (2 |φ'| + φ / π) / π: of normal noise 4 σ² φ + φ / π². Rows and the fixed pattern blur the place;
// rows are part of the noise.
void widen_by_coarse_steps(double quantization_dn, const std::vector<HiddenNoise>& hidden,
                           PhysicsCalibration& out) {
  if (!(quantization_dn > 0)) return;
  for (std::size_t c = 0; c < out.sigma_tl.mean.size(); ++c) {
    const double sd = out.temporal_sd_dark_dn[c], row = out.sigma_row.mean[c] / quantization_dn;
    if (!(sd > 0) || !std::isfinite(out.sigma_tl.mean[c])) continue;
    if (c < hidden.size() && hidden[c].hidden) continue;
    const LeftOfLaw law =
        coarse_of_tukey_lambda(out.lambda.mean[c], out.sigma_tl.mean[c] / quantization_dn);
    const double blur = coarse_of_normal(out.dsnu_dn[c] / quantization_dn) / std::numbers::sqrt2 *
                        coarse_of_normal(row);
    const double left = blur * law.left;
    const double variance =
        blur *
        (2.0 * law.slope +
         (4.0 * std::numbers::pi * row * row + 1.0 / std::numbers::pi) * law.left) /
        std::numbers::pi;
    double& error = out.temporal_sd_dark_stderr_dn[c];
    error = std::hypot(error, 0.5 * variance * quantization_dn * quantization_dn / sd);
    // The mean itself is off by φ sin 2πo / π.
    out.mu.standard_error[c] =
        std::hypot(out.mu.standard_error[c], left * quantization_dn / std::numbers::pi);
    widen_lines(2.0 * left, c, out.sigma_row);
    widen_lines(2.0 * left, c, out.sigma_column);
    out.dsnu_stderr_dn[c] = std::hypot(out.dsnu_stderr_dn[c], 2.0 * left * out.dsnu_dn[c]);
  }
}

}  // namespace malus
