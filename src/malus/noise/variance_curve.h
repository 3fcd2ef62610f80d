// Variance of a pixel against its signal.
#pragma once

#include <vector>

namespace malus {

/// Variance of a pixel about its clean signal (row noise excluded) against the signal in DN above
/// black.
class VarianceCurve {
 public:
  /// variance = slope_dn * max(signal, 0) + offset_dn2: Poisson-Gaussian, physics, heteroscedastic
  /// Gaussian. Contract: both >= 0, as in all models of physics (contradiction_in).
  static VarianceCurve affine(double slope_dn, double offset_dn2);
  /// A line whose offset may lie below 0: fitted well above the dark, or to pixels whose black
  /// level is not known. Such a line does not tell the noise where it would fall below least_dn2:
  /// there the curve is flat. Any other is affine. Contract: slope_dn, least_dn2 >= 0.
  static VarianceCurve fitted_line(double slope_dn, double offset_dn2, double least_dn2);
  /// Any line that would fall below least_dn2 above no signal is flat there. Contract as above.
  static VarianceCurve floored_line(double slope_dn, double offset_dn2, double least_dn2);
  /// Piecewise linear through measured knots (rising signals): non-parametric models. Constant
  /// below; above the last knot it rises by slope_above_dn.
  static VarianceCurve table(std::vector<double> signal_dn, std::vector<double> variance_dn2,
                             double slope_above_dn = 0);
  double operator()(double signal_dn) const;
  /// The curve with every variance multiplied by factor > 0.
  VarianceCurve scaled(double factor) const;
  /// With this much more at every signal; more_dn2 >= 0.
  VarianceCurve plus(double more_dn2) const;
  /// With what pixels differ by in a single frame, in place of what the curve has of it: their
  /// response by prnu of the signal, their dark signal by dsnu_dn. Contract: both >= 0.
  VarianceCurve with_pattern(double prnu, double dsnu_dn) const;
  /// Without it: from frame to frame.
  VarianceCurve temporal() const { return with_pattern(0, 0); }
  double prnu() const { return prnu_; }
  double dsnu_dn() const { return dsnu_dn_; }
  bool has_pattern() const { return prnu_ > 0 || dsnu_dn_ > 0; }
  bool is_affine() const { return signal_dn_.empty() && !has_pattern(); }
  double slope_dn() const { return slope_dn_; }      ///< contract: is_affine()
  double offset_dn2() const { return offset_dn2_; }  ///< contract: is_affine()

 private:
  double temporal_dn2(double signal_dn) const;

  double slope_dn_ = 0, offset_dn2_ = 0;  ///< slope_dn_: of a table, above its last knot
  std::vector<double> signal_dn_, variance_dn2_;
  double prnu_ = 0, dsnu_dn_ = 0;
};

/// Mean over the channels' curves. Contract: there is one.
double mean_variance_dn2(const std::vector<VarianceCurve>& curves, double signal_dn);

}  // namespace malus
