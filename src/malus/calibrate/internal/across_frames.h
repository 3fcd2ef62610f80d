// From one value per frame to mean, standard error, spread and covariance between channels
// (000, 3.3).
#pragma once

#include "malus/noise/calibration.h"

#include <vector>

namespace malus {

/// values[frame][channel].
using FrameSeries = std::vector<std::vector<double>>;

/// Mean over frames; standard error from the frames' scatter, which holds both the parameter's real
/// change from frame to frame and each frame's sampling error. With fewer than 20 frames scatter is
/// itself uncertain: the standard error is never below what the sampling error gives.
/// sampling: covariance of one frame's estimates around that frame's true parameters. The result's
/// covariance is that of the true parameters: the nearest positive semi-definite matrix to what
/// sampling leaves, of the same trace (which sampling alone makes 0 in the mean; negative ones are
/// 0). spread is the root of its diagonal. kept: 1 - 1/N where the mean of the N frames was
/// taken off each before its variances were measured: N such frames tell as much as N - 1
/// independent ones (two are mirror images). 1 where every frame stands for itself.
ChannelStatistics frame_statistics(const FrameSeries& values, const SquareMatrix& sampling,
                                   double kept = 1.0);

/// Deviations from per-frame variance components, e.g. σ_b from σ_b². Averaging squares first keeps
/// frames without visible row noise (negative components) from biasing the mean; the real
/// frame-to-frame spread τ is taken out again: mean² = E[v] - τ². Two standard errors span the
/// longer way to the root of the component's own two-standard-error bounds, so that they reach zero
/// where the component is not significant.
ChannelStatistics deviation_statistics(const FrameSeries& variances, const SquareMatrix& sampling,
                                       double kept = 1.0);

/// Covariance over frames between channels; zero for fewer than two frames.
SquareMatrix frame_covariance(const FrameSeries& values);

}  // namespace malus
