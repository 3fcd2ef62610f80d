// Variance stabilisation built from a channel's own variance curve, and its exact unbiased inverse.
// Forward: f(s) = integral of ds / sqrt(var(s) + 3/8 var'(s)^2): for an affine curve this is the
// generalised Anscombe transformation up to a constant (Starck, Murtagh, Bijaoui, "Image Processing
// and Data Analysis", 1998), for a measured curve the same thing built numerically. Below zero,
// where the variance is flat, f goes on as a straight line, so negative samples keep their value:
// of an affine curve by max(σ_read, K/4) DN per deviation, σ_read without light and K the slope.
// Inverse: s such that E[f(noisy) | s] equals the given value (Mäkitalo, Foi, "Optimal inversion of
// the generalized Anscombe transformation for Poisson-Gaussian noise", IEEE TIP 22(1), 2013), so a
// filter that averages stabilised samples comes back without bias. The expectation is that of the
// model's own distribution (noise_law.h): Poisson and Tukey-lambda, or the measured one.
#pragma once

#include "malus/noise/noise_law.h"
#include "malus/noise/variance_curve.h"

#include <vector>

namespace malus {

class Stabilizer {
 public:
  /// Of the highest signal: no deviation is taken as less, for the transformation of a channel
  /// without noise would not exist. Stabilised values stay below 2^18, which float32 holds to a
  /// 64th of a deviation. Of integers in a container of 16 bits it is less than their rounding.
  static constexpr double kLeastDeviation = 4e-6;
  /// In slopes of a line, the least deviation of what lies below zero, where read noise alone is
  /// left: of next to none, rounding would make many deviations.
  static constexpr double kLeastNegativeSlopes = 1.0 / 4;

  /// highest_dn: largest signal above black that occurs, > 0.
  /// law: distribution of the samples, of which the curve may be a multiple (a stronger or weaker
  /// denoising); the inverse is unbiased for it whatever the curve.
  Stabilizer(const VarianceCurve& variance, double highest_dn, const NoiseLaw& law);
  /// With NoiseLaw::gaussian(variance).
  Stabilizer(const VarianceCurve& variance, double highest_dn);

  /// Sample in DN above black and bias -> value whose noise has deviation 1. Rising everywhere.
  double forward(double dn) const;
  /// Mean of stabilised samples -> the signal in DN that has this mean. Rising everywhere.
  double inverse(double stabilized) const;
  /// Signal in DN -> mean of its stabilised samples: the inverse's inverse, to rounding.
  double mean_of(double signal_dn) const;
  /// d signal / d stabilised at a stabilised value: turns deviations back to DN.
  double inverse_slope(double stabilized) const;
  /// One variance for all signals: forward and inverse are the same line for every law.
  bool is_straight() const { return variance_.is_affine() && variance_.slope_dn() == 0; }

 private:
  void build_forward_table(double highest_dn);
  void build_inverse_table(double highest_dn, const NoiseLaw& law);
  std::vector<double> expectations_at(const std::vector<double>& knots, const NoiseLaw& law) const;

  VarianceCurve variance_;
  double floor_dn2_;              ///< least variance
  double dark_deviation_dn_;      ///< of the forward transformation at zero, from above
  double negative_deviation_dn_;  ///< below zero: that of the read noise alone
  std::vector<double> integral_;  ///< forward at multiples of signal_step_dn_; empty if affine
  double signal_step_dn_ = 0;
  std::vector<double> signal_dn_;  ///< inverse at inverse_low_ + i * kInverseStep, if not straight
  double inverse_low_ = 0;
};

/// Variance that the law gives stabilised samples: 1 but in the dark, where it is less, and of a
/// curve that is a multiple of the law's. Apart from the stabilizer, most of whose users never ask.
class StabilizedVariance {
 public:
  /// highest_dn, law: the stabilizer's.
  StabilizedVariance(const Stabilizer& stabilizer, double highest_dn, const NoiseLaw& law);
  /// Of samples of this mean.
  double at(double stabilized) const;

 private:
  double dark_mean_;               ///< of the samples without light
  std::vector<double> variances_;  ///< at dark_mean_ + i * kVarianceStep; the last of all above
};

}  // namespace malus
