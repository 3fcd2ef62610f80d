#include "malus/noise/internal/gain_law.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/noise/internal/table_at.h"

#include <algorithm>
#include <cmath>

namespace malus::internal {
namespace {

using Values = std::vector<double>;

// 1 - error² / residual², not below zero: what of the residuals is the sensor's own. With unknown
// errors all of it.
double real_share(const Values& residual, const Values& error, double degrees) {
  double residual2 = 0, error2 = 0;
  for (double r : residual) residual2 += r * r;
  for (double e : error) error2 += e * e;
  if (residual2 <= 0 || degrees <= 0) return 0;
  return std::max(0.0, 1.0 - error2 / static_cast<double>(error.size()) / (residual2 / degrees));
}

// Where an error is unknown, what the gains around tell of it; 0 where none is known.
Values known_errors(const Values& x, const Values& error) {
  Values known_x, known;
  for (std::size_t i = 0; i < x.size(); ++i)
    if (error[i] > 0) {
      known_x.push_back(x[i]);
      known.push_back(error[i]);
    }
  Values all(x.size(), 0.0);
  for (std::size_t i = 0; i < x.size() && !known.empty(); ++i)
    all[i] = error[i] > 0 ? error[i] : table_at(known_x, known, x[i]);
  return all;
}

LogLinear constant_law(double value, std::size_t knots) {
  LogLinear law;
  law.signed_linear = value <= 0;
  law.intercept = law.signed_linear ? value : std::log(value);
  law.residual.assign(knots, 0.0);
  return law;
}

// Sum of the squared relative residuals of y about fitted(x).
template <class Fitted>
double relative_misfit(const Values& x, const Values& y, const Fitted& fitted) {
  double sum = 0;
  for (std::size_t i = 0; i < x.size(); ++i) sum += std::pow(fitted(x[i]) / y[i] - 1, 2);
  return sum;
}

}  // namespace

LogLinear fit_line_law(const Values& x, const Values& y, const Values& error,
                       const std::vector<bool>& usable) {
  Values xs, ys, errors;
  for (std::size_t i = 0; i < x.size(); ++i)
    if (usable[i]) {
      xs.push_back(x[i]);
      ys.push_back(y[i]);
      errors.push_back(error[i]);
    }
  const LineFit fit = fit_line(xs, ys);
  LogLinear law;
  law.slope = fit.slope;
  law.intercept = fit.intercept;
  law.residual.assign(x.size(), 0.0);
  Values kept;
  for (std::size_t i = 0; i < x.size(); ++i)
    if (usable[i]) {
      law.residual[i] = y[i] - fit.intercept - fit.slope * x[i];
      kept.push_back(law.residual[i]);
    }
  if (xs.size() > 2) {
    law.slope_stderr = fit.slope_standard_error;
    law.intercept_stderr = fit.intercept_standard_error;
    law.residual_sd = fit.residual_deviation;
    law.residual_weight = real_share(kept, errors, static_cast<double>(xs.size()) - 2.0);
  }
  return law;
}

// In DN, where errors grow with the gain: equal weights would let that of the highest, which may be
// fifty times that of the lowest, turn the line and decide how much of all residuals is real.
LogLinear fit_signed_law(const Values& x, const Series& series) {
  const Values error = known_errors(x, series.error);
  const bool known = error.front() > 0;
  Values weight;
  for (std::size_t i = 0; known && i < x.size(); ++i) weight.push_back(1 / (error[i] * error[i]));
  const LineFit fit = fit_line(x, series.value, weight);
  LogLinear law;
  law.slope = fit.slope;
  law.intercept = fit.intercept;
  law.signed_linear = true;
  double chi_square = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    law.residual.push_back(series.value[i] - fit.intercept - fit.slope * x[i]);
    if (known) chi_square += weight[i] * law.residual[i] * law.residual[i];
  }
  if (x.size() > 2) {
    const double degrees = static_cast<double>(x.size()) - 2.0;
    law.slope_stderr = fit.slope_standard_error;
    law.intercept_stderr = fit.intercept_standard_error;
    law.residual_sd = fit.residual_deviation;
    law.residual_weight = !known ? 1.0 : chi_square > degrees ? 1.0 - degrees / chi_square : 0.0;
  }
  return law;
}

LogLinear fit_law(const Values& log_K, const Series& series, Logarithm logarithm) {
  const std::size_t n = log_K.size();
  const auto [lowest, highest] = std::minmax_element(series.value.begin(), series.value.end());
  if (*lowest == *highest) return constant_law(*lowest, n);  // one gain, or published as constant
  if (logarithm == Logarithm::kNone) return fit_signed_law(log_K, series);
  std::vector<bool> positive(n);
  for (std::size_t i = 0; i < n; ++i) positive[i] = series.value[i] > 0;
  const auto count = static_cast<std::size_t>(std::count(positive.begin(), positive.end(), true));
  MALUS_REQUIRE(count == n || logarithm == Logarithm::kOfPositive);
  if (count < 2)  // no law; its mean over all gains
    return constant_law(std::max(mean_of(series.value), 0.0), n);
  Values y(n, 0.0), error(n, 0.0);
  for (std::size_t i = 0; i < n; ++i)
    if (positive[i]) {
      y[i] = std::log(series.value[i]);
      error[i] = series.error[i] / series.value[i];
    }
  return fit_line_law(log_K, y, error, positive);
}

bool is_power_of_K(const Values& log_K, const Series& minus_mu) {
  constexpr double kClearlyPositive = 5;  // standard errors
  Values K, log_value, weight;
  for (std::size_t i = 0; i < log_K.size(); ++i) {
    if (!(minus_mu.value[i] > kClearlyPositive * minus_mu.error[i])) return false;
    K.push_back(std::exp(log_K[i]));
    log_value.push_back(std::log(minus_mu.value[i]));
    weight.push_back(1 / (minus_mu.value[i] * minus_mu.value[i]));
  }
  if (K.size() < 3) return true;  // both pass through two
  const LineFit power = fit_line(log_K, log_value), line = fit_line(K, minus_mu.value, weight);
  const auto by_power = [&](double x) { return std::exp(power.intercept + power.slope * x); };
  const auto by_line = [&](double x) { return line.intercept + line.slope * x; };
  return relative_misfit(log_K, minus_mu.value, by_power) <=
         relative_misfit(K, minus_mu.value, by_line);
}

}  // namespace malus::internal
