#include "malus/calibrate/internal/row_offset.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

// A value that makes up most of its own offset tells nothing of its variance.
constexpr double kLargestWeight = 0.25, kLeastShare = 0.1;

// Weights 1/variance that add to one, none above kLargestWeight (or all equal, where they are few).
void weigh(const std::vector<double>& variance, std::vector<double>& weight) {
  double least = *std::min_element(variance.begin(), variance.end());
  for (double sum = 0;; least *= 1.5) {
    sum = 0;
    for (std::size_t i = 0; i < variance.size(); ++i)
      sum += weight[i] = 1.0 / std::max(variance[i], least);
    for (double& w : weight) w /= sum;
    const double largest = *std::max_element(weight.begin(), weight.end());
    if (largest <= std::max(kLargestWeight, 1.001 / static_cast<double>(weight.size()))) return;
  }
}

}  // namespace

void RowOffset::fit(const std::vector<double>& value_dn, const std::vector<double>& variance_dn2) {
  MALUS_REQUIRE(value_dn.size() >= 2 && variance_dn2.size() == value_dn.size());
  const std::size_t n = value_dn.size();
  variance_ = variance_dn2;
  weight_.resize(n);
  residual_.resize(n);
  weigh(variance_, weight_);
  double mean = 0;
  expected_mean_dn2_ = 0;
  for (std::size_t i = 0; i < n; ++i) {
    mean += weight_[i] * value_dn[i];
    expected_mean_dn2_ += weight_[i] * weight_[i] * variance_[i];
  }
  const bool known = std::isfinite(prior_dn2_);
  share_ = known ? prior_dn2_ / (prior_dn2_ + expected_mean_dn2_) : 1.0;
  left_dn2_ = known ? (1.0 - share_) * (1.0 - share_) * prior_dn2_ : 0.0;
  // Σ w² v from the residuals themselves: E[r²] above, solved for it.
  double seen = 0, squares = 0;
  for (std::size_t i = 0; i < n; ++i) {
    residual_[i] = value_dn[i] - share_ * mean;
    const double factor = weight_[i] * weight_[i] / std::max(own_share(i), kLeastShare);
    seen += factor * residual_[i] * residual_[i];
    squares += factor;
  }
  mean_dn2_ = (seen - left_dn2_ * squares) / (1.0 + share_ * share_ * squares);
}

double RowOffset::variance_share(std::size_t i) const {
  return own_share(i) + (share_ * share_ * expected_mean_dn2_ + left_dn2_) / variance_[i];
}

double RowOffset::residual_dn(std::size_t i) const {
  return residual_[i] / std::sqrt(variance_share(i));
}

double RowOffset::square_dn2(std::size_t i) const {
  const double square = residual_[i] * residual_[i];
  return own_share(i) < kLeastShare  // two or three values: as if all had one variance
             ? square / variance_share(i)
             : (square - share_ * share_ * mean_dn2_ - left_dn2_) / own_share(i);
}

double RowOffset::freedom(std::size_t i) const {
  const double share = std::max(own_share(i), kLeastShare) / variance_share(i);
  return std::min(share * share, 1.0);
}

}  // namespace malus
