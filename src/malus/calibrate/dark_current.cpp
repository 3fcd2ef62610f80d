#include "malus/calibrate/internal/dark_current.h"

#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr double kOfSquare = 0.1;  // of PRNU's, which is 5 % of itself

// Variance of the pixels' dark currents; its standard error is infinite where nothing tells.
struct Spread {
  double variance_dn2_per_s2 = 0, standard_error = std::numeric_limits<double>::infinity();
};

// The levels' squares rise with the square of exposure over light.
Spread fitted_spread(const std::vector<ResponseLevel>& levels) {
  constexpr double kUnlike = 1.44;  // exposure over light: 1.2
  std::vector<double> x, y, weights;
  for (const ResponseLevel& level : levels)
    if (std::isfinite(level.prnu2) && level.prnu2_stderr > 0) {
      x.push_back(level.s2_per_dn2);
      y.push_back(level.prnu2);
      weights.push_back(1.0 / (level.prnu2_stderr * level.prnu2_stderr));
    }
  if (x.empty()) return {};
  const auto [low, high] = std::minmax_element(x.begin(), x.end());
  if (!(*high > kUnlike * *low)) return {};
  const LineFit line = fit_line(x, y, weights, true);
  double chi2 = 0;
  for (std::size_t i = 0; i < x.size(); ++i)
    chi2 += weights[i] * std::pow(y[i] - line.intercept - line.slope * x[i], 2);
  const double freedom = std::max(static_cast<double>(x.size()) - 2.0, 1.0);
  return {line.slope, line.slope_standard_error * std::sqrt(std::max(chi2 / freedom, 1.0))};
}

// Whether it may well be: no more than a warm sensor has, of a PRNU that is one.
bool may_be_dark_current(double darkless_s, double s_per_dn, const Response& response,
                         const PhysicsCalibration& out) {
  constexpr double kLong_s = 1.0, kBrief_s = 0.3, kWarm_e_per_s = 50, kLeastPrnu = 0.003,
                   kMostPrnu = 0.01;  // more may be dark current itself
  if (darkless_s >= kLong_s) return true;
  if (darkless_s < kBrief_s || out.K.mean.empty()) return false;
  const double warm = kWarm_e_per_s * mean_of(out.K.mean) * s_per_dn;
  const double prnu = std::clamp(mean_of(response.prnu), kLeastPrnu, kMostPrnu);
  return warm * warm > kOfSquare * prnu * prnu;
}

}  // namespace

void take_dark_current(const std::vector<ResponseLevel>& levels, Response& response,
                       PhysicsCalibration& out) {
  constexpr double kErrors = 5.0, kSure = 2.0;
  constexpr const char* kRemedy =
      "add [[frames]] with kind = \"bias\" and each of the flats' exposures";
  double longest_s = 0, darkless_s = 0;
  for (const ResponseLevel& level : levels) {
    if (level.darkless_s == 0) continue;
    longest_s = std::max(longest_s, level.exposure_s);
    darkless_s = std::max(darkless_s, std::abs(level.darkless_s));
  }
  const double s_per_dn = std::abs(mean_of(response.darkless_s_per_dn)),
               prnu = mean_of(response.prnu);
  if (!(s_per_dn > 0)) return;
  const Spread spread = fitted_spread(levels);
  const double shown = s_per_dn * s_per_dn / (prnu * prnu),  // share of PRNU's square
      share = spread.variance_dn2_per_s2 * shown, error = spread.standard_error * shown;
  if (share > std::max(kErrors * error, kOfSquare)) {
    for (std::size_t c = 0; c < response.prnu.size(); ++c) {
      const double of_dn2 = std::pow(response.darkless_s_per_dn[c], 2), all = response.prnu[c];
      const double left = std::max(all * all - spread.variance_dn2_per_s2 * of_dn2, 0.0);
      response.prnu[c] = std::sqrt(left);
      response.prnu_stderr[c] = root_standard_error(
          left, std::hypot(2 * all * response.prnu_stderr[c], spread.standard_error * of_dn2));
    }
    out.warnings.push_back(fmt::format(
        "PRNU grows with the exposure for the same light: dark current that differs from pixel to "
        "pixel by {:.3g} DN/s, without which PRNU is {:.3g} %, not {:.3g} %; the map of the "
        "response holds it; {}",
        std::sqrt(spread.variance_dn2_per_s2), 100 * mean_of(response.prnu), 100 * prnu, kRemedy));
    return;
  }
  const bool is_none = share + kSure * error < kOfSquare;
  if (is_none || !may_be_dark_current(darkless_s, s_per_dn, response, out)) return;
  out.warnings.push_back(
      fmt::format("flats of up to {:.3g} s have no dark frames of their exposure: dark current "
                  "that differs from pixel to pixel counts as PRNU, {:.2g} DN/s as 5 % of it; {}",
                  longest_s, std::sqrt(kOfSquare / shown), kRemedy));
}

}  // namespace malus
