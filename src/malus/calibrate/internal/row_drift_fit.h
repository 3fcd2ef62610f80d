// Slow drift of the rows (noise/row_drift.h) from the row groups' offsets in bias frames.
#pragma once

#include "malus/base/estimate.h"
#include "malus/calibrate/internal/across_frames.h"
#include "malus/noise/row_drift.h"

#include <vector>

namespace malus {

struct FittedRowDrift : MeasuredRowDrift {
  double share_length_covariance = 0;  ///< of the two's errors
  double evidence = 0;                 ///< 2 ln L against white rows
};

/// offsets_dn: [frame][row group] mean of the group's pixels. White noise of variance
/// explained_dn2[group % phases] in them is the pixels' own; phases: row groups after which the
/// layout repeats, each with a level and a deviation of its own. independent_frames: frames, less
/// one where their mean was subtracted from them.
///
/// Maximises Whittle's likelihood of the frames' mean periodogram with the expected periodogram of
/// finite frames (Sykulski, Olhede, Guillaumin, Lilly, Early, "The debiased Whittle likelihood",
/// Biometrika 106, 2019, eq. 5). Undecided, which means white, with fewer than 2 frames or 32
/// groups, and where the likelihood ratio against white rows, 2 ln L, stays below the evidence
/// asked for. Of kRowDriftEvidence: chance of a false drift below 1 in 1000.
inline constexpr double kRowDriftEvidence = 20.0;
Estimate<FittedRowDrift> fit_row_drift(const FrameSeries& offsets_dn,
                                       const std::vector<double>& explained_dn2,
                                       int independent_frames,
                                       double least_evidence = kRowDriftEvidence);

/// What drift adds to the sampling of one frame, as sums over the lags of white rows' terms. A
/// channel has n row groups, `stride` apart; those of the other channel lie `shift` further on.
/// Covariance of the two channels' means: sigma_b sigma_b' / n times 1 (where they share groups)
/// plus this. The groups' variance about that mean loses 1/(n-1) of the same sum at shift 0.
double drift_of_means(const RowDrift& drift, int n, int stride, int shift);
/// Standard error that the fit's own errors give drift_of_means at shift 0, to first order.
double drift_of_means_stderr(const FittedRowDrift& fitted, int n, int stride);
/// Covariance of the two channels' variances of row groups: 2 (sigma_b sigma_b')² / (n-1) times 1
/// (where they share groups) plus this.
double drift_of_variances(const RowDrift& drift, int n, int stride, int shift);

}  // namespace malus
