// Variance of a pixel against its signal.
#pragma once

#include <vector>

namespace malus {

/// Variance of a pixel about its clean signal (row noise excluded) against the signal in DN above
/// black.
class VarianceCurve {
 public:
  /// variance = max(slope_dn * max(signal, 0) + offset_dn2, 0): Poisson-Gaussian, physics,
  /// heteroscedastic Gaussian. An offset may lie below 0, where a line was fitted well above the
  /// dark. Contract: slope_dn >= 0, as in all models (contradiction_in).
  static VarianceCurve affine(double slope_dn, double offset_dn2);
  /// Piecewise linear through measured knots (rising signals): non-parametric models. Constant
  /// below; above the last knot it rises by slope_above_dn.
  static VarianceCurve table(std::vector<double> signal_dn, std::vector<double> variance_dn2,
                             double slope_above_dn = 0);
  double operator()(double signal_dn) const;
  /// The curve with every variance multiplied by factor > 0.
  VarianceCurve scaled(double factor) const;
  bool is_affine() const { return signal_dn_.empty(); }
  double slope_dn() const { return slope_dn_; }      ///< contract: is_affine()
  double offset_dn2() const { return offset_dn2_; }  ///< contract: is_affine()

 private:
  double slope_dn_ = 0, offset_dn2_ = 0;  ///< slope_dn_: of a table, above its last knot
  std::vector<double> signal_dn_, variance_dn2_;
};

}  // namespace malus
