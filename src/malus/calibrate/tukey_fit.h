// Shape λ and scale σ_TL of read noise from the residuals of bias frames (000 Eq. 3 and 3.2).
#pragma once

#include "malus/base/estimate.h"

#include <array>
#include <cstdint>
#include <vector>

namespace malus {

/// Counts of |residual| in cells of equal width: cell i holds [i, i+1) * cell_dn. The distribution
/// is symmetric, so the sign carries nothing about shape and scale. Unbounded: nothing is clipped.
class ResidualHistogram {
 public:
  ResidualHistogram() = default;
  explicit ResidualHistogram(double cell_dn) : cell_dn_(cell_dn) {}
  struct Cell {
    std::int32_t index;
    std::uint32_t count;
  };
  double cell_dn() const { return cell_dn_; }
  double centre_dn(const Cell& cell) const { return (cell.index + 0.5) * cell_dn_; }
  /// Rising index, counts above zero.
  const std::vector<Cell>& cells() const { return cells_; }
  std::int64_t count() const;
  void add(const ResidualHistogram& other);
  /// Moves dense counts and the few cells beyond them in.
  void assign(const std::vector<std::uint32_t>& dense, std::vector<std::int32_t>& beyond);

 private:
  double cell_dn_ = 1.0;
  std::vector<Cell> cells_;
};

/// What blurs a residual besides read noise: the converter's step, and the error of the row mean
/// and of the fixed pattern that were subtracted.
struct ResidualBlur {
  double quantization_dn = 1.0;
  double offset_variance_dn2 = 0.0;
};

struct TukeyFit {
  double lambda = 0, scale_dn = 0;
  /// Covariance of (λ, ln scale) that one sample would have: divide by the number of samples.
  std::array<double, 3> unit_covariance{};  ///< λλ, λs, ss
};

/// λ is searched here: below -1/2 the variance is infinite, at 1 the noise is uniform.
inline constexpr double kLambdaLow = -0.45, kLambdaHigh = 1.0;

/// Maximum likelihood. An integer residual r given its (real-valued) offset has the probability
/// F(r + q/2) - F(r - q/2), so ties need no care and the lattice's phase does not matter; F is the
/// Tukey-lambda distribution widened by the offsets' error. Undecided: fewer than 200 samples, no
/// spread, or λ at the end of its range (the reason says which).
Estimate<TukeyFit> fit_tukey_lambda(const ResidualHistogram& histogram, const ResidualBlur& blur);

/// The papers' estimator: λ maximises the correlation between ordered residuals and quantiles (the
/// mean quantile over each cell's ties), the scale is the slope with the blur's variance taken out.
/// unit_covariance is zero: its error comes from the scatter of groups of frames.
Estimate<TukeyFit> fit_tukey_lambda_ppcc(const ResidualHistogram& histogram,
                                         const ResidualBlur& blur);

/// One frame's (λ, ln scale) by one Newton step from a fit to all frames: the maximum-likelihood
/// estimate to first order, without the bias that small samples give a full fit; the mean over
/// the frames is the pooled fit itself.
class FrameShapes {
 public:
  /// pooled: the histogram that fit was made from.
  FrameShapes(const TukeyFit& fit, const ResidualHistogram& pooled, const ResidualBlur& blur);
  struct Shape {
    double lambda, log_scale;
  };
  Shape of(const ResidualHistogram& frame) const;

 private:
  TukeyFit fit_;
  std::vector<std::int32_t> index_;
  std::vector<double> lambda_score_, scale_score_;
};

}  // namespace malus
