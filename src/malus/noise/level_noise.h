// The noise of a non-parametric model at any signal, not only at the levels that were measured:
// between two levels a mixture of both by the fractional distance, as sampling does (001, S2);
// above the brightest one its distribution, widened as shot noise grows.
//
// Levels hold the noise of frames as they were recorded, but for that of signal zero where the
// camera rounds to a step: it holds the noise before rounding, so that rounding a draw at signal
// zero gives each code as often as the bias frames had it, and at any other signal the right noise.
#pragma once

#include "malus/noise/calibration.h"

#include <vector>

namespace malus {

/// A distribution as its piecewise linear cumulative function: probability p[i] below x[i].
struct Cumulative {
  std::vector<double> x, p;
  double below(double x_dn) const;
  double mean() const;
  double standard_deviation() const;
};

/// K of a channel in DN/e-, 0 where the calibration has none.
double gain_of_channel(const NonparametricCalibration& calibration, std::size_t channel);

/// What deviations of the brightest level are multiplied by above_dn above it: photon transfer,
/// variance = V + K above. 1 below it, and where K or V is not known (0).
double spread_above_levels(double variance_dn2, double gain_dn_per_e, double above_dn);

/// The distribution of noisy - clean at a signal; below the darkest level that one's.
Cumulative noise_at(const NonparametricChannel& channel, double signal_dn,
                    double gain_dn_per_e = 0);

/// Whether a level holds the noise before the converter's rounding to step_dn (0: none).
bool before_rounding(const NonparametricChannel& channel, std::size_t level, double step_dn);
/// Variance of one level's noise, rounding in it.
double recorded_variance_dn2(const NonparametricChannel& channel, std::size_t level,
                             double step_dn);
/// The channel with the rounding in all of its levels.
NonparametricChannel as_recorded(NonparametricChannel channel, double step_dn);

/// Probabilities of `bins` bins of width_dn, centred on zero; what lies outside counts to the end
/// bins. blur_dn: width of a uniform distribution that is added first.
std::vector<double> equal_bins(const Cumulative& noise, double width_dn, int bins,
                               double blur_dn = 0);

/// Signals that one channel was measured at, DN above black: from the darkest level to the
/// brightest, with half a step to either side, which their samples come from.
struct LevelRange {
  double darkest_dn = 0, brightest_dn = 0;
  bool continued = false;  ///< K is known: noise grows above the brightest level
};
/// One per channel.
std::vector<LevelRange> level_ranges(const NonparametricCalibration& calibration);
/// What both know.
std::vector<LevelRange> common_ranges(const std::vector<LevelRange>& a,
                                      const std::vector<LevelRange>& b);

}  // namespace malus
