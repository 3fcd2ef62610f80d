// What a denoiser must know of the noise at one gain, whatever kind of model it came from.
#pragma once

#include "malus/image/layout.h"

#include <vector>

namespace malus {

/// Variance of a pixel about its clean signal (row noise excluded) against the signal in DN above
/// black.
class VarianceCurve {
 public:
  /// variance = max(slope_dn * signal, 0) + offset_dn2: Poisson-Gaussian, physics, heteroscedastic
  /// Gaussian.
  static VarianceCurve affine(double slope_dn, double offset_dn2);
  /// Piecewise linear through measured knots (rising signals), constant outside: non-parametric
  /// models.
  static VarianceCurve table(std::vector<double> signal_dn, std::vector<double> variance_dn2);
  double operator()(double signal_dn) const;
  /// The curve with every variance multiplied by factor > 0.
  VarianceCurve scaled(double factor) const;
  bool is_affine() const { return signal_dn_.empty(); }
  double slope_dn() const { return slope_dn_; }      ///< contract: is_affine()
  double offset_dn2() const { return offset_dn2_; }  ///< contract: is_affine()

 private:
  double slope_dn_ = 0, offset_dn2_ = 0;
  std::vector<double> signal_dn_, variance_dn2_;
};

struct ChannelProfile {
  VarianceCurve variance;
  double bias_dn = 0;        ///< mean of dark pixels above the black level
  double sigma_row_dn = 0;   ///< sd of the row groups' offsets
  double gain_dn_per_e = 0;  ///< 0 when not known
};

struct NoiseProfile {
  SensorLayout layout;
  std::vector<ChannelProfile> channels;  ///< one per channel of the layout
  int row_group = 1;
  bool estimated_from_picture = false;  ///< no model was given
};

}  // namespace malus
