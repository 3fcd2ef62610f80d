// The few estimators that several modules share.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace malus {

/// Streaming mean and central moments up to the fourth (Pébay, SAND2008-6212); mergeable in a fixed
/// order.
class Moments {
 public:
  void add(double x);
  void merge(const Moments& other);
  std::int64_t count() const { return count_; }
  double mean() const { return mean_; }
  double variance() const;  ///< unbiased; NaN for fewer than two samples
  /// Standard error of variance(), from the fourth moment: Var(s²) = (μ4 - σ⁴ (n-3)/(n-1)) / n.
  double variance_standard_error() const;

 private:
  std::int64_t count_ = 0;
  double mean_ = 0, m2_ = 0, m3_ = 0, m4_ = 0;
};

/// Standard error of the root of a square that is known to `error`, of 0 where it came out
/// negative: to first order far from zero, and no more than the range of the root near it.
double root_standard_error(double square, double error);

double mean_of(std::span<const double> values);
double standard_deviation_of(
    std::span<const double> values);  ///< unbiased variance's root; NaN below two
/// Middle value (mean of the two middle ones); the copy is deliberate: inputs stay as they are. NaN
/// when empty.
double median_of(std::vector<double> values);
/// Median of |z| for a standard normal z (its quantile of 3/4): a median of sizes over it is a
/// deviation.
inline constexpr double kMedianOfNormal = 0.67448975019608171;
/// median |x - median| / kMedianOfNormal: the standard deviation of a Gaussian, robust to half of
/// the values.
double robust_deviation_of(const std::vector<double>& values);

/// y = intercept + slope x by weighted least squares.
struct LineFit {
  double slope = 0, intercept = 0;
  double slope_standard_error = 0, intercept_standard_error = 0;
  double residual_deviation = 0;  ///< sqrt(sum w r² / (n-2)) for weights scaled to mean one
};

/// weights = 1/variance of each y, or empty for equal ones. With known_variances the standard
/// errors come from the weights alone; otherwise they are scaled by the residuals. Contract: at
/// least two different x.
LineFit fit_line(std::span<const double> x, std::span<const double> y,
                 std::span<const double> weights = {}, bool known_variances = false);

}  // namespace malus
