#include "malus/noise/row_drift.h"

#include "malus/base/error.h"

#include <cmath>

#include <fmt/format.h>

namespace malus {

std::string contradiction_in(const RowDrift& drift) {
  if (!(drift.share >= 0 && drift.share <= 1))
    return fmt::format("has a share of {}, not between 0 and 1", drift.share);
  if (drift.white()) return drift.length_groups == 0 ? "" : "has a length without a share";
  if (!(drift.length_groups >= kShortestRowDrift && drift.length_groups <= kLongestRowDrift))
    return fmt::format("has a length of {} row groups, not between {} and {}", drift.length_groups,
                       kShortestRowDrift, kLongestRowDrift);
  return "";
}

std::string text_of(const MeasuredRowDrift& measured) {
  MALUS_REQUIRE(!measured.drift.white());
  const auto with_error = [](double value, double error, int digits) {
    return error > 0 ? fmt::format("{:.{}f} ± {:.{}f}", value, digits, error, digits)
                     : fmt::format("{:.{}f}", value, digits);
  };
  return fmt::format("{} % of the rows' variance, over {} row groups",
                     with_error(100 * measured.drift.share, 100 * measured.share_stderr, 0),
                     with_error(measured.drift.length_groups, measured.length_stderr, 1));
}

double row_autocorrelation(const RowDrift& drift, int lag) {
  if (lag == 0) return 1.0;
  return drift.white() ? 0.0 : drift.share * std::exp(-lag / drift.length_groups);
}

double row_power(const RowDrift& drift, double frequency) {
  if (drift.white()) return 1.0;
  const double decay = std::exp(-1.0 / drift.length_groups);
  return 1.0 - drift.share +
         drift.share * (1.0 - decay * decay) /
             (1.0 - 2.0 * decay * std::cos(frequency) + decay * decay);
}

std::vector<double> row_kernel(const RowDrift& drift) {
  constexpr double kSmallest = 1e-3;
  if (drift.white()) return {1.0};
  const double decay = std::exp(-1.0 / drift.length_groups);
  // z_g = decay z_(g-1) + e_g + theta e_(g-1) has rho(1) = share decay where
  // a theta² + b theta + a = 0; the root inside the unit circle.
  const double a = decay * (1.0 - drift.share);
  const double b = 1.0 + decay * decay * (1.0 - 2.0 * drift.share);
  const double theta = -2.0 * a / (b + std::sqrt(b * b - 4.0 * a * a));
  std::vector<double> kernel = {1.0};
  double squares = 1.0;
  for (double fall = 1.0; fall > kSmallest; fall *= decay) {
    kernel.push_back((decay + theta) * fall);
    squares += kernel.back() * kernel.back();
  }
  for (double& weight : kernel) weight /= std::sqrt(squares);
  return kernel;
}

RowDrift interpolated(const RowDrift& low, const RowDrift& high, double t) {
  const double share = (1.0 - t) * low.share + t * high.share;
  if (share == 0) return {};
  if (low.white()) return {share, high.length_groups};
  if (high.white()) return {share, low.length_groups};
  return {share,
          std::exp((1.0 - t) * std::log(low.length_groups) + t * std::log(high.length_groups))};
}

}  // namespace malus
