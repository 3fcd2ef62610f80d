// How likely Tukey-lambda noise puts a residual into each cell of a histogram: what tukey_fit.h
// maximises.
#pragma once

#include "malus/calibrate/internal/residual_histogram.h"

#include <vector>

namespace malus {

/// What blurs a residual besides read noise: the converter's step, and the error of the row mean
/// and of the fixed pattern that were subtracted.
struct ResidualBlur {
  double quantization_dn = 1.0;
  double offset_variance_dn2 = 0.0;
};

/// Probability p of a residual r of an integer converter, given its offset: the distribution
/// widened by a normal offset error over one step q, at every cell's centre.
///
/// Its plain logarithm trusts the law out to where no value can be: for λ > 0 all ends at scale/λ,
/// and a single value near that end, of noise that is not quite Tukey-lambda, would pin λ there and
/// be most of its information. So the fit maximises
///
///     mean log(p + a) + a/q ∫ log(1 + p/a) dr
///
/// whose derivative is that of the likelihood weighted by p / (p + a), less its expectation: the
/// integral's derivative is -∫ log(p + a) taken over the law itself, so that of Tukey-lambda noise
/// (λ, scale) come out without bias whatever a is (conditionally unbiased bounded influence:
/// Künsch, Stefanski and Carroll, JASA 84, 1989).
class CellDensity {
 public:
  CellDensity(const ResidualHistogram& histogram, const ResidualBlur& blur);
  /// log(p + a) plus the integral, by cell. lambda: above -1/2 and below 2.
  std::vector<double> log_density(double lambda, double log_scale) const;

 private:
  void lay_nodes(double rms_dn);
  void lay_kernel(const ResidualBlur& blur, double cell_dn);
  std::vector<double> probability(const std::vector<double>& distance_dn, double lambda,
                                  double log_scale) const;
  std::vector<double> of_smooth_law(const std::vector<double>& distance_dn, double lambda,
                                    double log_scale) const;
  std::vector<double> of_bounded_law(const std::vector<double>& distance_dn, double lambda,
                                     double log_scale) const;
  double kernel_within(double distance_dn) const;

  double deviation_dn_, half_step_dn_, floor_;      ///< floor_: a, of a probability
  std::vector<double> centre_, node_, node_width_;  ///< at rising distances, DN
  double kernel_step_dn_ = 0;
  std::vector<double> within_;  ///< the kernel's integral from 0 on
};

}  // namespace malus
