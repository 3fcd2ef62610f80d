// Dark noise whose lower end the camera cuts off at a floor (DN 0, or its lowest code), by what
// lies as far above the level: read noise is symmetric (000 Eq. 3).
#pragma once

#include "malus/calibrate/internal/residual_histogram.h"

namespace malus {

/// Where a channel's dark pixels lie above the floor.
struct CutOffPlace {
  double level_dn = 0;    ///< their mean as it shows
  double spread_dn = 0;   ///< deviation of their offsets, from pixel to pixel and row to row
  double step_dn = 0;     ///< of the codes; 0: none
  double zero_share = 0;  ///< of them at the floor
  double blur_dn2 = 0;    ///< variance of what residuals hold of the error of a pixel's offset
};

/// What the cut took from the noise.
struct CutOffNoise {
  double shift_dn = 0;      ///< mean as it shows, minus the true one
  double variance_dn2 = 0;  ///< true variance minus that which shows
  /// What the true variance's standard error has beyond that of the variance that shows, in
  /// squares.
  double variance_stderr_dn2 = 0;
  double slope = 1;     ///< share of an offset's change that shows
  double rows_dn2 = 0;  ///< what the cut took from the rows' variance, σ_b²
  bool known = false;
  /// Told by the mirror image of what shows, but for shares of zeros beyond it: then by the
  /// Tukey-lambda law that shows as much, whose shape is this.
  bool by_law = false;
  double shift_stderr_dn = 0, lambda = 0, lambda_stderr = 0;  ///< by_law
};

/// Residuals beyond this share of zeros tell too little of what they were.
inline constexpr double kMostMirroredZeros = 0.2;

/// Residuals about the level as it shows: all, by size, and those above it. No more is taken for
/// cut off than pixels show zeros. Not known where there is nothing cut off, or more than
/// kMostMirroredZeros.
CutOffNoise find_cut_off_noise(const ResidualHistogram& all, const ResidualHistogram& above,
                               const CutOffPlace& place);

/// Sizes of the residuals before the cut, about the true level: those that reach down to the cut
/// are as many as reach as far up.
ResidualHistogram residuals_before_cut_off(const ResidualHistogram& all,
                                           const ResidualHistogram& above, const CutOffPlace& place,
                                           const CutOffNoise& cut);

}  // namespace malus
