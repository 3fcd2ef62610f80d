// The plots of a calibration, one function per figure; each choice is a gain.
#pragma once

#include "malus/noise/model.h"
#include "malus/report/report.h"

#include <functional>
#include <string>
#include <vector>

namespace malus::app {

using Variants = std::vector<ChartsBlock::Variant>;

/// "Bias at 12 dB"; without a known gain "Bias".
std::string title_at(const std::string& what, const GainSetting& gain);

/// Where a flat level of one channel is drawn, with the standard error of y.
struct FlatPoint {
  double x = 0, y = 0, error = 0;
};
/// Flat levels of one channel: those that K was fitted to, and those left out with the reason.
struct FlatSeries {
  PointSeries used, left_out;
};
FlatSeries flat_series(const PhysicsCalibration& p, const SensorLayout& layout, int channel,
                       const std::function<FlatPoint(const PhotonTransferPoint&)>& place);
/// A block of charts to choose from by gain, where there are any.
void add_charts(std::vector<Block>& blocks, Variants variants, bool wide = false);
/// Those that have points.
void add_series(FlatSeries series, Chart& chart);

/// Variance against mean with the fitted lines, and what is left of it (000 Fig. 2).
std::vector<Block> transfer_plots(const NoiseModel& model);
/// Signal over noise against the signal; signal against exposure and its distance from the line
/// (EMVA 1288).
std::vector<Block> response_plots(const NoiseModel& model);
/// Box plots of sigma_b, mu, sigma_TL per channel (000 Fig. 3).
std::vector<Block> box_plots(const NoiseModel& model);
/// Correlation between channels, and pairs of channels with their Gaussians (000 Fig. 4).
std::vector<Block> correlation_plots(const NoiseModel& model);
/// Parameters against the mean gain with the joint model's lines (000 Fig. 5, Eq. 7).
std::vector<Block> law_plots(const NoiseModel& model);
/// Read noise against Gaussian and Tukey lambda: density and probability plot.
std::vector<Block> distribution_plots(const NoiseModel& model);
/// Profiles and spectrograms of the fixed pattern, and its maps.
std::vector<Block> pattern_plots(const NoiseModel& model);
/// Probabilities per level of a non-parametric model (001, S2).
std::vector<Block> level_plots(const NoiseModel& model);

}  // namespace malus::app
