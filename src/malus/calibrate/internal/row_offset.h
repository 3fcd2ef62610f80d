// What the pixels of one row group have in common, estimated where their noise is of unlike width.
#pragma once

#include <cstddef>
#include <vector>

namespace malus {

/// The offset that all values of one group share, by weights 1/variance (a bright pixel of a scene
/// says little beside a dark one) and drawn towards zero by prior over prior plus sampling
/// variance: where there is no row noise nothing is taken off. With weights w, their mean m and
/// that share b a residual x - b m has, whatever the values' variances v are, the variance
///
///     v (1 - 2 b w) + b² Σ w² v + (1 - b)² prior
///
/// which is undone: by the variances expected in residual(), by those seen in square().
class RowOffset {
 public:
  /// prior_dn2: variance of the offsets; infinity: not known, and the mean is taken off whole.
  explicit RowOffset(double prior_dn2) : prior_dn2_(prior_dn2) {}

  /// One group: its values and the variances expected of them without the offset; these need be
  /// right to a factor only. Contract: of one size, two or more, variances above zero.
  void fit(const std::vector<double>& value_dn, const std::vector<double>& variance_dn2);

  /// Value i without the offset.
  double raw_dn(std::size_t i) const { return residual_[i]; }
  /// The same, scaled to the variance it has of its own.
  double residual_dn(std::size_t i) const;
  /// Unbiased estimate of value i's own variance, whatever was expected of it.
  double square_dn2(std::size_t i) const;
  /// Independent samples that this estimate is worth, at most 1: 2 v² over its variance.
  double freedom(std::size_t i) const;

 private:
  double own_share(std::size_t i) const { return 1.0 - 2.0 * share_ * weight_[i]; }
  double variance_share(std::size_t i) const;
  double prior_dn2_;
  double share_ = 1.0, left_dn2_ = 0.0;            ///< b; (1 - b)² prior
  double expected_mean_dn2_ = 0, mean_dn2_ = 0.0;  ///< Σ w² v: expected, and seen
  std::vector<double> residual_, weight_, variance_;
};

}  // namespace malus
