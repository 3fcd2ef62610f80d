// The distribution of a channel's pixels about their clean signal (row noise excluded), in the form
// that expectations need: nodes and weights. One form for all kinds of models: physics (Poisson and
// Tukey-lambda, 000 Eq. 1-4), heteroscedastic Gaussian, and measured distributions (001, S1-S2).
#pragma once

#include "malus/noise/calibration.h"
#include "malus/noise/physics.h"
#include "malus/noise/variance_curve.h"

#include <functional>
#include <limits>
#include <optional>
#include <vector>

namespace malus {

class NoiseLaw {
 public:
  /// Of a variance curve whose distribution is not known further: Poisson of the slope and a
  /// Gaussian of the offset for an affine curve, a Gaussian for a table.
  static NoiseLaw gaussian(const VarianceCurve& variance);
  /// Poisson, Tukey-lambda and quantisation; without the channel's mean mu.
  static NoiseLaw physics(const PhysicsChannel& channel, const PhysicsParts& parts,
                          double quantization_dn);
  /// Measured levels; between two of them a mixture by the fractional distance, as when sampling;
  /// the darkest goes on below, the brightest above as level_noise.h says. The bias is subtracted:
  /// it is what a profile holds as the channel's.
  static NoiseLaw measured(const NonparametricChannel& channel, double bias_dn,
                           double gain_dn_per_e = 0);

  /// Of pixels that end at the lowest code floor_dn: as gaussian(variance), cut off and rounded to
  /// multiples of step_dn above it (0: not rounded), whose variance step_dn^2 / 12 the given one
  /// holds. Contract: more than that.
  static NoiseLaw clipped(const VarianceCurve& variance, double floor_dn, double step_dn);
  /// The law, which has none of it yet, of pixels that differ in response and dark signal besides
  /// (VarianceCurve::with_pattern), by normal deviates. gaussian has its curve's.
  NoiseLaw with_pattern(double prnu, double dsnu_dn) const;
  /// Of the mean of `frames` pixels of the law, whose variance is given: by the central limit a
  /// Poisson and a Gaussian, but for the read noise's tails.
  NoiseLaw mean_of(int frames, const VarianceCurve& variance) const;
  bool is_clipped() const { return floor_dn_ > -std::numeric_limits<double>::infinity(); }
  /// How far a clean signal lies above the code that noise is cut off at, in deviations of the dark
  /// noise; infinite where nothing is.
  double above_floor(double signal_dn) const {
    return (signal_dn - floor_dn_) / dark_deviation_dn_;
  }

  /// E f(pixel) for clean signals in DN above black and bias; f continuous. Error for functions
  /// with the curvature of a variance stabilisation: below 1e-3 of the local deviation.
  std::vector<double> expectations(const std::function<double(double)>& f,
                                   const std::vector<double>& signals_dn) const;

  /// Probability that the read noise alone lies further than this from its mean, distance_dn > 0:
  /// of the Tukey-lambda part, or of the darkest measured level. 0 where nothing is known of it but
  /// a variance.
  double read_tail(double distance_dn) const;

 private:
  struct Node {
    double x_dn, weight;
  };
  using Nodes = std::vector<Node>;
  static Nodes normal_nodes(double deviation);
  static Nodes merged(Nodes nodes, double apart_dn);
  void set_read_nodes(Nodes nodes, double deviation_dn);
  std::vector<double> temporal_expectations(const std::function<double(double)>& f,
                                            const std::vector<double>& signals_dn) const;
  double mean_at(const std::function<double(double)>& f, double signal_dn) const;
  double mean_over_codes(const std::function<double(double)>& f, double signal_dn,
                         double deviation_dn) const;

  double lambda_ = 0, sigma_tl_dn_ = 0;  ///< of the read noise; sigma 0: none is known
  int frames_ = 1;                       ///< a mean of as many pixels with this read noise
  double shot_dn_per_e_ = 0;             ///< 0: no Poisson part
  std::vector<double> level_dn_;  ///< signals of the nodes; empty where one set serves them all
  std::vector<Nodes> nodes_;      ///< per level
  Nodes far_nodes_;  ///< three of the same moments, for signals above far_dn_; empty: none are
  double far_dn_ = 0;
  double brightest_variance_dn2_ = 0, gain_above_dn_per_e_ = 0;  ///< of levels
  std::optional<VarianceCurve> deviation_;  ///< squared, for nodes of a normal deviate
  double floor_dn_ = -std::numeric_limits<double>::infinity(), step_dn_ = 0;  ///< of the codes
  double dark_deviation_dn_ = 0;  ///< of a clipped law, before it is rounded
  double prnu_ = 0;               ///< pixels' responses differ by this
};

}  // namespace malus
