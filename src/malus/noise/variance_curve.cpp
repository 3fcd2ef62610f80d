#include "malus/noise/variance_curve.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cmath>

namespace malus {

VarianceCurve VarianceCurve::affine(double slope_dn, double offset_dn2) {
  MALUS_REQUIRE(slope_dn >= 0 && offset_dn2 >= 0);
  VarianceCurve curve;
  curve.slope_dn_ = slope_dn;
  curve.offset_dn2_ = offset_dn2;
  return curve;
}

VarianceCurve VarianceCurve::fitted_line(double slope_dn, double offset_dn2, double least_dn2) {
  if (slope_dn == 0 || offset_dn2 >= 0) return affine(slope_dn, std::max(offset_dn2, 0.0));
  return floored_line(slope_dn, offset_dn2, least_dn2);
}

VarianceCurve VarianceCurve::floored_line(double slope_dn, double offset_dn2, double least_dn2) {
  MALUS_REQUIRE(slope_dn >= 0 && least_dn2 >= 0);
  if (slope_dn == 0 || offset_dn2 >= least_dn2)
    return affine(slope_dn, std::max(offset_dn2, least_dn2));
  return table({(least_dn2 - offset_dn2) / slope_dn}, {least_dn2}, slope_dn);
}

VarianceCurve VarianceCurve::table(std::vector<double> signal_dn, std::vector<double> variance_dn2,
                                   double slope_above_dn) {
  MALUS_REQUIRE(!signal_dn.empty() && signal_dn.size() == variance_dn2.size());
  MALUS_REQUIRE(std::is_sorted(signal_dn.begin(), signal_dn.end()));
  VarianceCurve curve;
  curve.signal_dn_ = std::move(signal_dn);
  curve.variance_dn2_ = std::move(variance_dn2);
  curve.slope_dn_ = slope_above_dn;
  return curve;
}

double VarianceCurve::operator()(double signal_dn) const {
  const double temporal = temporal_dn2(signal_dn);
  if (!has_pattern()) return temporal;
  const double response_dn = prnu_ * std::max(signal_dn, 0.0);
  return temporal + response_dn * response_dn + dsnu_dn_ * dsnu_dn_;
}

double VarianceCurve::temporal_dn2(double signal_dn) const {
  if (signal_dn_.empty()) return slope_dn_ * std::max(signal_dn, 0.0) + offset_dn2_;
  const auto above = std::upper_bound(signal_dn_.begin(), signal_dn_.end(), signal_dn);
  if (above == signal_dn_.begin()) return variance_dn2_.front();
  if (above == signal_dn_.end())
    return variance_dn2_.back() + slope_dn_ * (signal_dn - signal_dn_.back());
  const auto i = static_cast<std::size_t>(above - signal_dn_.begin());
  const double t = (signal_dn - signal_dn_[i - 1]) / (signal_dn_[i] - signal_dn_[i - 1]);
  return variance_dn2_[i - 1] + t * (variance_dn2_[i] - variance_dn2_[i - 1]);
}

VarianceCurve VarianceCurve::scaled(double factor) const {
  MALUS_REQUIRE(factor > 0);
  VarianceCurve curve = *this;
  curve.slope_dn_ *= factor;
  curve.offset_dn2_ *= factor;
  for (double& variance : curve.variance_dn2_) variance *= factor;
  return curve.with_pattern(std::sqrt(factor) * prnu_, std::sqrt(factor) * dsnu_dn_);
}

VarianceCurve VarianceCurve::plus(double more_dn2) const {
  MALUS_REQUIRE(more_dn2 >= 0);
  VarianceCurve curve = *this;
  curve.offset_dn2_ += more_dn2;
  for (double& variance : curve.variance_dn2_) variance += more_dn2;
  return curve;
}

VarianceCurve VarianceCurve::with_pattern(double prnu, double dsnu_dn) const {
  MALUS_REQUIRE(prnu >= 0 && dsnu_dn >= 0);
  VarianceCurve curve = *this;
  curve.prnu_ = prnu;
  curve.dsnu_dn_ = dsnu_dn;
  return curve;
}

double mean_variance_dn2(const std::vector<VarianceCurve>& curves, double signal_dn) {
  MALUS_REQUIRE(!curves.empty());
  double sum = 0;
  for (const VarianceCurve& curve : curves) sum += curve(signal_dn);
  return sum / static_cast<double>(curves.size());
}

}  // namespace malus
