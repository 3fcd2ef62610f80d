// Shape λ and scale σ_TL of read noise from the residuals of bias frames (000 Eq. 3 and 3.2).
#pragma once

#include "malus/base/estimate.h"
#include "malus/calibrate/internal/cell_density.h"
#include "malus/calibrate/internal/residual_histogram.h"

#include <array>
#include <cstdint>
#include <vector>

namespace malus {

struct TukeyFit {
  double lambda = 0, scale_dn = 0;
  /// Covariance of (λ, ln scale) that one sample would have: divide by the number of samples. True
  /// of noise that is not quite Tukey-lambda, too (Godambe, Ann. Math. Statist. 31, 1960).
  std::array<double, 3> unit_covariance{};  ///< λλ, λs, ss
  std::array<double, 3> unit_step{};  ///< of Newton's method: from the mean score to (λ, ln scale)
};

/// λ is searched here: below -1/2 the variance is infinite, at 1 the noise is uniform, and its
/// estimates lie on both sides.
inline constexpr double kLambdaLow = -0.45, kLambdaHigh = 1.25;

/// Maximum likelihood, in which values where the law's density all but ends count for little (an
/// end that one value could pin otherwise). An integer residual r given its (real-valued) offset
/// has the probability F(r + q/2) - F(r - q/2), so ties need no care and the lattice's phase does
/// not matter; F is the Tukey-lambda distribution widened by the offsets' error. Undecided: fewer
/// than 200 samples, no spread, or λ at the end of its range (the reason says which).
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
