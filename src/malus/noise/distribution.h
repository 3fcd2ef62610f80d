// The distribution of one noisy pixel about a clean signal, as numbers: Poisson * Tukey-lambda *
// uniform (000 Eq. 1-4 without the row term). Double precision by closed forms and sums; the truth
// that samplers are tested against, and electron counts for expectations over a pixel's law.
#pragma once

#include "malus/noise/physics.h"

#include <vector>

namespace malus {

/// Tukey-lambda read noise plus uniform quantisation noise, centred at zero and symmetric.
/// The uniform part is convolved in closed form through
///   integral over (0,p) of Q(1-v) dv = -[(1-p) E(log(1-p)) + p E(log p)] / (λ+1),
/// E(a) = (exp(λ a) - 1)/λ.
class ReadDistribution {
 public:
  /// lambda > -0.5; scale_dn, quantization_dn >= 0, where 0 leaves the part out.
  ReadDistribution(double lambda, double scale_dn, double quantization_dn);

  /// P(X > x); relative error < 1e-8 down to 1e-12.
  double upper_tail(double x_dn) const;
  double cdf(double x_dn) const { return upper_tail(-x_dn); }
  /// Inverse of cdf for u in (0,1).
  double quantile(double u) const;
  double variance_dn2() const;
  /// Nodes and weights for expectations of smooth functions: sum w f(x) = E f(X).
  struct Node {
    double x_dn, weight;
  };
  const std::vector<Node>& nodes() const { return nodes_; }

 private:
  double lambda_, scale_, half_step_;
  std::vector<Node> nodes_;
};

/// One pixel: D = K N + mu + read + quantisation, N ~ Poisson(signal/K). Parts switched off are
/// left out; signals <= 0 have no shot noise and keep their value.
class PixelDistribution {
 public:
  PixelDistribution(const PhysicsChannel& channel, const PhysicsParts& parts,
                    double quantization_dn, double signal_dn);

  double cdf(double x_dn) const;
  double upper_tail(double x_dn) const;
  double quantile(double u) const;
  double mean_dn() const { return mean_; }
  double variance_dn2() const { return variance_; }
  const ReadDistribution& read() const { return read_; }
  /// The electron counts that matter, as DN with the bias, and their probabilities.
  const std::vector<double>& levels_dn() const { return level_dn_; }
  const std::vector<double>& probabilities() const { return probability_; }

 private:
  ReadDistribution read_;
  double mean_ = 0, variance_ = 0;
  /// Whole electron counts that matter (all but 1e-14 of the probability), as DN, with probability.
  std::vector<double> level_dn_, probability_;
};

}  // namespace malus
