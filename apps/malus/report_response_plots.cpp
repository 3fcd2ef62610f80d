// Plots of the EMVA Standard 1288 beside photon transfer: signal to noise, and linearity.
#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/noise/data_sheet.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "report_plots.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

bool knows_electrons(const PhysicsCalibration& p) {
  return !p.K.mean.empty() && !p.temporal_sd_dark_dn.empty();
}

constexpr double kMostOfLight = 1.5;  // of the light's own ratio of signal to noise

// Points of a flat level in electrons. The transfer curve's variance is without the dark one, which
// a long exposure has more of than the bias frames. Where saturation has cut the light's own noise
// off, the ratio tells nothing of the camera, and may be thousands.
FlatPoint signal_to_noise_point(const PhysicsCalibration& p, const PhotonTransferPoint& point) {
  const double bias_dn = p.temporal_sd_dark_dn[as_index(point.channel)];
  const double dark_dn2 = point.dark_variance_dn2 > 0 ? point.dark_variance_dn2 : bias_dn * bias_dn;
  const double variance_dn2 = point.variance_dn2 + dark_dn2;
  const double signal_e = point.mean_dn / p.K.mean[as_index(point.channel)];
  const double ratio = point.mean_dn / std::sqrt(variance_dn2);
  if (ratio > kMostOfLight * std::sqrt(signal_e)) return {signal_e, Measured::kNone, 0};
  // A level may lie below black by its noise; its error has no sign.
  return {signal_e, ratio, 0.5 * std::abs(ratio) * point.variance_stderr_dn2 / variance_dn2};
}

Chart signal_to_noise_chart(const NoiseModel& model, const PhysicsCalibration& p) {
  Chart chart{title_at("Signal to noise", p.gain),
              "Mean signal of the flat frames over their temporal noise, against the signal. The "
              "line is what K and the noise of the bias frames predict, means over the channels; "
              "dashed, light's "
              "own noise alone. Differences between pixels (PRNU) are not part of it.",
              {"signal", "e-", AxisScale::kLogarithmic},
              {"signal / noise", "1", AxisScale::kLogarithmic},
              {}};
  double full_e = 0;
  for (int channel = 0; channel < model.layout.channels(); ++channel) {
    full_e = std::max(full_e, saturation_level_dn(model, p, channel) / p.K.mean[as_index(channel)]);
    add_series(flat_series(p, model.layout, channel,
                           [&](const PhotonTransferPoint& point) {
                             return signal_to_noise_point(p, point);
                           }),
               chart);
  }
  PointSeries camera{.name = "K and dark noise", .mark = Mark::kLine},
      light{.name = "light's own noise", .mark = Mark::kDashed};
  const double dark_e = mean_of(p.temporal_sd_dark_dn) / mean_of(p.K.mean);
  constexpr int kPoints = 48;
  for (int i = 0; i <= kPoints; ++i) {
    const double signal_e = std::pow(full_e, static_cast<double>(i) / kPoints);
    for (PointSeries* line : {&camera, &light}) {
      line->x.push_back(signal_e);
      line->y.push_back(signal_to_noise(signal_e, line == &camera ? dark_e : 0.0));
    }
  }
  chart.series.emplace_back(std::move(camera));
  chart.series.emplace_back(std::move(light));
  return chart;
}

PointSeries line_over(const LineFit& line, const PointSeries& points, const std::string& name) {
  const auto [low, high] = std::minmax_element(points.x.begin(), points.x.end());
  PointSeries drawn{.name = name + ", line", .mark = Mark::kLine, .tone = name};
  for (const double exposure_s : {*low, *high}) {
    drawn.x.push_back(exposure_s);
    drawn.y.push_back(line.intercept + line.slope * exposure_s);
  }
  return drawn;
}

// Signal against exposure, and its distance from the line; empty charts where no line is known.
struct LinearityCharts {
  Chart signal, deviation;
};
LinearityCharts linearity_charts(const NoiseModel& model, const PhysicsCalibration& p) {
  LinearityCharts charts{
      {title_at("Linearity", p.gain),
       "Mean signal of the flat frames against their exposure, and the line through the levels "
       "between 5 and 95 % of saturation, but not at white, that weighs relative deviations "
       "equally. Crosses took no part in the gain.",
       {"exposure", "s"},
       {"mean signal", "DN"},
       {}},
      {title_at("Linearity, deviation", p.gain),
       "Mean signal minus that line, over the line. The mean of the sizes is the data sheet's "
       "linearity error.",
       {"exposure", "s"},
       {"deviation", "%"},
       {}}};
  for (int channel = 0; channel < model.layout.channels(); ++channel) {
    const double full_dn = saturation_level_dn(model, p, channel);
    const auto line = linearity_line(p.transfer, channel, full_dn);
    if (!line) continue;
    FlatSeries series = flat_series(p, model.layout, channel, [](const PhotonTransferPoint& point) {
      return FlatPoint{point.exposure_s > 0 ? point.exposure_s : Measured::kNone, point.mean_dn, 0};
    });
    PointSeries deviation{
        .name = series.used.name, .mark = Mark::kPoints, .tone = series.used.tone};
    for (const PhotonTransferPoint& point : p.transfer) {
      if (point.channel != channel || !counts_for_linearity(point, full_dn)) continue;
      const double expected_dn = line->intercept + line->slope * point.exposure_s;
      deviation.x.push_back(point.exposure_s);
      deviation.y.push_back(100 * (point.mean_dn - expected_dn) / expected_dn);
    }
    charts.signal.series.emplace_back(line_over(*line, deviation, deviation.name));
    series.used.error.clear();
    series.left_out.error.clear();
    add_series(std::move(series), charts.signal);
    charts.deviation.series.emplace_back(std::move(deviation));
  }
  return charts;
}

}  // namespace

std::vector<Block> response_plots(const NoiseModel& model) {
  Variants ratios, signals, deviations;
  for (const PhysicsCalibration& p : model.physics) {
    if (knows_electrons(p)) ratios.push_back({p.gain.text(), signal_to_noise_chart(model, p)});
    LinearityCharts linearity = linearity_charts(model, p);
    if (linearity.signal.series.empty()) continue;
    signals.push_back({p.gain.text(), std::move(linearity.signal)});
    deviations.push_back({p.gain.text(), std::move(linearity.deviation)});
  }
  std::vector<Block> blocks;
  add_charts(blocks, std::move(ratios), true);
  add_charts(blocks, std::move(signals));
  add_charts(blocks, std::move(deviations));
  return blocks;
}

}  // namespace malus::app
