// What read noise looks like in the residuals of a converter's codes, which are not the noise
// itself: for plots that set a law beside measured residuals.
#pragma once

#include <functional>

namespace malus {

/// What a residual holds besides its noise.
struct ResidualBlurring {
  double step_dn = 1;              ///< of the converter; 0: none
  double offset_variance_dn2 = 0;  ///< of the normal error of the offset that was subtracted
};

/// The law of a residual r of an integer pixel about its offset (docs/calibration.md, "Shape and
/// scale"): the density P(r)/q with P(r) = F(r + q/2) - F(r - q/2), F that of the noise and of the
/// offset's error. calibrate/internal/cell_density.h tabulates the same for the fit.
class ResidualLaw {
 public:
  /// Tukey-lambda noise. Contract: lambda > -1/2, scale_dn > 0.
  static ResidualLaw tukey(double lambda, double scale_dn, const ResidualBlurring& blur);
  /// Normal noise. Contract: deviation_dn > 0.
  static ResidualLaw normal(double deviation_dn, const ResidualBlurring& blur);
  /// Probability of a residual above r_dn, relatively exact far out on the upper side.
  double above(double r_dn) const;
  /// Mean density [1/DN] over a bin about r_dn, which is what a histogram shows. Contract: bin_dn
  /// > 0.
  double density(double r_dn, double bin_dn) const;

 private:
  // ∫ F of the bare noise from -∞ to x [DN].
  using Ramp = std::function<double(double)>;
  ResidualLaw(Ramp ramp, double deviation_dn, const ResidualBlurring& blur);
  Ramp ramp_;
  double half_step_dn_, offset_deviation_dn_;
};

}  // namespace malus
