#include "report_plots.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/noise/data_sheet.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus::app {
namespace {

double value_at(const std::vector<double>& values, int channel) {
  return as_index(channel) < values.size() ? values[as_index(channel)] : Measured::kNone;
}

Axis channel_axis(const SensorLayout& layout) {
  return {"channel", "1", AxisScale::kCategory, layout.channel_names()};
}

// Mean and variance of one channel's flat levels.
FlatSeries transfer_series(const PhysicsCalibration& p, const SensorLayout& layout, int channel) {
  return flat_series(p, layout, channel, [](const PhotonTransferPoint& point) {
    return FlatPoint{point.mean_dn, point.variance_dn2, point.variance_stderr_dn2};
  });
}

PointSeries fitted_line(const PhysicsCalibration& p, const std::string& name, int channel,
                        double low, double high) {
  PointSeries line{.name = name + ", fit", .mark = Mark::kLine, .tone = name};
  constexpr int kPoints = 24;
  for (int i = 0; i <= kPoints; ++i) {
    const double x = low * std::pow(high / low, static_cast<double>(i) / kPoints);
    line.x.push_back(x);
    line.y.push_back(transfer_intercept_dn2(p, channel) + value_at(p.K.mean, channel) * x);
  }
  return line;
}

// The used range of all channels, for the line; empty when no point was used.
std::pair<double, double> used_range(const PhysicsCalibration& p) {
  double low = std::numeric_limits<double>::infinity(), high = 0;
  for (const PhotonTransferPoint& point : p.transfer)
    if (point.used && point.mean_dn > 0) {
      low = std::min(low, point.mean_dn);
      high = std::max(high, point.mean_dn);
    }
  return {low, high};
}

Chart transfer_chart(const NoiseModel& model, const PhysicsCalibration& p) {
  Chart chart{title_at("Photon transfer", p.gain),
              "Temporal variance of the flat frames, dark variance taken off, against the mean "
              "signal above dark. The slope is the overall gain K. Crosses were left out; the "
              "reason is in the numbers.",
              {"mean signal", "DN", AxisScale::kLogarithmic},
              {"temporal variance", "DN^2", AxisScale::kLogarithmic},
              {}};
  const auto [low, high] = used_range(p);
  for (int channel = 0; channel < model.layout.channels(); ++channel) {
    const std::string name = model.layout.channel_name(channel);
    add_series(transfer_series(p, model.layout, channel), chart);
    if (high > low && as_index(channel) < p.K.mean.size())
      chart.series.emplace_back(fitted_line(p, name, channel, low, high));
  }
  return chart;
}

// "χ² = 41.2 with 38 degrees of freedom": over all channels, and the channel that departs most.
std::string misfit_text(const NoiseModel& model, const PhysicsCalibration& p) {
  TransferMisfit all;
  int worst = -1;
  double most = 0;
  for (int channel = 0; channel < static_cast<int>(p.K.mean.size()); ++channel) {
    const TransferMisfit misfit = transfer_misfit(p, channel);
    all.chi_square += misfit.chi_square;
    all.degrees_of_freedom += misfit.degrees_of_freedom;
    const double per_degree = misfit.chi_square / std::max(misfit.degrees_of_freedom, 1);
    if (misfit.degrees_of_freedom > 0 && per_degree > most) {
      most = per_degree;
      worst = channel;
    }
  }
  if (all.degrees_of_freedom == 0) return "";
  std::string text = fmt::format(" χ² = {:.4g} with {} degrees of freedom", all.chi_square,
                                 all.degrees_of_freedom);
  if (p.K.mean.size() > 1 && worst >= 0)
    text += fmt::format(", most in {}: {:.2g} per degree", model.layout.channel_name(worst), most);
  return text + " (1 per degree is what sampling alone leaves).";
}

Chart residual_chart(const NoiseModel& model, const PhysicsCalibration& p) {
  Chart chart{title_at("Photon transfer, residuals", p.gain),
              "Variance minus the fitted line, over the line; bars are standard errors." +
                  misfit_text(model, p),
              {"mean signal", "DN", AxisScale::kLogarithmic},
              {"residual", "%"},
              {}};
  for (int channel = 0; channel < model.layout.channels(); ++channel) {
    if (as_index(channel) >= p.K.mean.size()) break;
    PointSeries series = transfer_series(p, model.layout, channel).used;
    for (std::size_t i = 0; i < series.x.size(); ++i) {
      const double line =
          transfer_intercept_dn2(p, channel) + value_at(p.K.mean, channel) * series.x[i];
      series.y[i] = 100 * (series.y[i] - line) / line;
      series.error[i] *= 100 / line;
    }
    if (!series.x.empty()) chart.series.emplace_back(std::move(series));
  }
  return chart;
}

Chart box_chart(const NoiseModel& model, const PhysicsCalibration& p, const std::string& name,
                const std::string& symbol, const ChannelStatistics& statistics) {
  Chart chart{
      title_at(name + " per channel", p.gain), {}, channel_axis(model.layout), {symbol, "DN"}, {}};
  if (statistics.per_frame.empty()) {
    chart.text = "Mean over the frames; bars are its standard errors.";
    PointSeries points{.name = symbol, .mark = Mark::kPoints};
    for (int c = 0; c < model.layout.channels(); ++c) {
      points.x.push_back(c);
      points.y.push_back(value_at(statistics.mean, c));
      const double error = value_at(statistics.standard_error, c);
      points.error.push_back(std::isfinite(error) ? error : 0.0);
    }
    chart.series.emplace_back(std::move(points));
    return chart;
  }
  chart.text = fmt::format(
      "Every box holds the estimates of {} bias frames, sampling error and "
      "all; whiskers reach 1.5 quartile ranges.",
      statistics.per_frame.size());
  BoxSeries boxes{symbol, model.layout.channel_names(), {}};
  boxes.samples.resize(as_index(model.layout.channels()));
  for (const auto& frame : statistics.per_frame)
    for (std::size_t c = 0; c < frame.size(); ++c)
      if (std::isfinite(frame[c])) boxes.samples[c].push_back(frame[c]);
  // A channel without estimates keeps its place.
  for (std::size_t c = 0; c < boxes.samples.size(); ++c)
    if (boxes.samples[c].empty()) boxes.samples[c].push_back(statistics.mean[c]);
  chart.series.emplace_back(std::move(boxes));
  return chart;
}

constexpr double kShownErrors = 2.0;  // a variance below this many of its errors is not seen

// Channels that change from frame to frame by more than sampling explains. All where the frames'
// own values are not known.
std::vector<bool> changing_channels(const ChannelStatistics& statistics) {
  const SquareMatrix& real = statistics.covariance;
  std::vector<bool> changing(as_index(real.n), true);
  const std::size_t frames = statistics.per_frame.size();
  if (frames < 2) return changing;
  for (int c = 0; c < real.n; ++c) {
    Moments values;
    for (const auto& frame : statistics.per_frame) values.add(frame[as_index(c)]);
    const double sampling = std::max(values.variance() - real(c, c), 0.0);
    const double error = sampling * std::sqrt(2.0 / static_cast<double>(frames - 1));
    changing[as_index(c)] = real(c, c) > kShownErrors * error;
  }
  return changing;
}

// Channels whose row noise is above two of its errors.
std::vector<bool> channels_with_rows(const PhysicsCalibration& p) {
  std::vector<bool> seen;
  for (int c = 0; c < p.row_correlation.n; ++c) {
    const double error = value_at(p.sigma_row.standard_error, c);
    seen.push_back(!(value_at(p.sigma_row.mean, c) <= kShownErrors * error));
  }
  return seen;
}

// No value where one of the two channels has nothing to correlate.
std::vector<std::vector<double>> correlations(const SquareMatrix& matrix,
                                              const std::vector<bool>& known) {
  const SquareMatrix correlation = correlation_of(matrix);
  std::vector<std::vector<double>> rows;
  for (int r = 0; r < matrix.n; ++r) {
    auto& row = rows.emplace_back();
    for (int c = 0; c < matrix.n; ++c)
      row.push_back(known[as_index(r)] && known[as_index(c)] ? correlation(r, c) : Measured::kNone);
  }
  return rows;
}

void add_correlation(Variants& variants, const NoiseModel& model, const PhysicsCalibration& p,
                     const std::string& of, std::string text, const SquareMatrix& matrix,
                     const std::vector<bool>& known) {
  if (matrix.n < 2) return;
  const Axis axis = channel_axis(model.layout);
  Chart chart{title_at("Correlation of " + of, p.gain), std::move(text), axis, axis, {}};
  chart.series.emplace_back(
      HeatSeries{"correlation", "1", correlations(matrix, known), -1, 1, Palette::kDiverging});
  variants.push_back({p.gain.text(), std::move(chart)});
}

void add_frame_correlation(Variants& variants, const NoiseModel& model, const PhysicsCalibration& p,
                           const std::string& of, const ChannelStatistics& statistics) {
  const std::size_t frames = statistics.per_frame.size();
  add_correlation(
      variants, model, p, of,
      fmt::format("Over {}, sampling error taken out. Empty where a channel changes "
                  "no more than sampling explains (two standard errors).",
                  frames > 0 ? fmt::format("{} bias frames", frames) : "the bias frames"),
      statistics.covariance, changing_channels(statistics));
}

Chart pair_chart(const NoiseModel& model, const PhysicsCalibration& p, int a, int b) {
  const std::string first = model.layout.channel_name(a), second = model.layout.channel_name(b);
  Chart chart{title_at(fmt::format("μ of {} against μ of {}", first, second), p.gain),
              "Points are frames. The curves hold 68 and 95 % of the fitted Gaussian, sampling "
              "error taken out; none where one of the two changes no more than sampling explains.",
              {"μ " + first, "DN"},
              {"μ " + second, "DN"},
              {}};
  PointSeries frames{.name = "frames", .mark = Mark::kPoints};
  for (const auto& frame : p.mu.per_frame) {
    frames.x.push_back(frame[as_index(a)]);
    frames.y.push_back(frame[as_index(b)]);
  }
  if (!frames.x.empty()) chart.series.emplace_back(std::move(frames));
  const std::vector<bool> changing = changing_channels(p.mu);
  if (!changing[as_index(a)] || !changing[as_index(b)]) return chart;
  // Radii that hold 68.3 and 95.4 % in two dimensions: sqrt(-2 ln(1 - share)).
  for (const auto& [share, label] : {std::pair{0.683, "68 %"}, {0.954, "95 %"}})
    chart.series.emplace_back(gaussian_ellipse(
        label, p.mu.mean[as_index(a)], p.mu.mean[as_index(b)], p.mu.covariance(a, a),
        p.mu.covariance(b, b), p.mu.covariance(a, b), std::sqrt(-2 * std::log(1 - share))));
  return chart;
}

}  // namespace

std::string title_at(const std::string& what, const GainSetting& gain) {
  return gain.decibel() ? fmt::format("{} at {}", what, gain.text()) : what;
}

FlatSeries flat_series(const PhysicsCalibration& p, const SensorLayout& layout, int channel,
                       const std::function<FlatPoint(const PhotonTransferPoint&)>& place) {
  const std::string name = layout.channel_name(channel);
  FlatSeries made{{.name = name, .mark = Mark::kPoints, .tone = name},
                  {.name = name + ", left out", .mark = Mark::kCrosses, .tone = name}};
  for (const PhotonTransferPoint& point : p.transfer) {
    if (point.channel != channel) continue;
    PointSeries& series = point.used ? made.used : made.left_out;
    const FlatPoint at = place(point);
    series.x.push_back(at.x);
    series.y.push_back(at.y);
    series.error.push_back(at.error);
    series.notes.push_back(point.why_not);
  }
  return made;
}

void add_charts(std::vector<Block>& blocks, Variants variants, bool wide) {
  if (!variants.empty()) blocks.emplace_back(ChartsBlock{"Gain", std::move(variants), wide});
}

void add_series(FlatSeries series, Chart& chart) {
  for (PointSeries* points : {&series.used, &series.left_out})
    if (!points->x.empty()) chart.series.emplace_back(std::move(*points));
}

std::vector<Block> transfer_plots(const NoiseModel& model) {
  Variants curves, residuals;
  for (const PhysicsCalibration& p : model.physics) {
    if (p.transfer.empty()) continue;
    curves.push_back({p.gain.text(), transfer_chart(model, p)});
    residuals.push_back({p.gain.text(), residual_chart(model, p)});
  }
  std::vector<Block> blocks;
  add_charts(blocks, std::move(curves), true);
  add_charts(blocks, std::move(residuals), true);
  return blocks;
}

std::vector<Block> box_plots(const NoiseModel& model) {
  std::vector<Block> blocks;
  const auto add = [&](const std::string& name, const std::string& symbol,
                       ChannelStatistics PhysicsCalibration::*field) {
    Variants variants;
    for (const PhysicsCalibration& p : model.physics)
      if (!(p.*field).mean.empty())
        variants.push_back({p.gain.text(), box_chart(model, p, name, symbol, p.*field)});
    add_charts(blocks, std::move(variants));
  };
  add("Row noise σ_b", "σ_b", &PhysicsCalibration::sigma_row);
  add("Bias μ", "μ", &PhysicsCalibration::mu);
  add("Read noise scale σ_TL", "σ_TL", &PhysicsCalibration::sigma_tl);
  add("Column noise", "σ_column", &PhysicsCalibration::sigma_column);
  return blocks;
}

std::vector<Block> correlation_plots(const NoiseModel& model) {
  Variants mu, sigma, rows, pairs;
  const int n = model.layout.channels();
  for (const PhysicsCalibration& p : model.physics) {
    add_frame_correlation(mu, model, p, "μ between channels", p.mu);
    add_frame_correlation(sigma, model, p, "σ_b between channels", p.sigma_row);
    add_correlation(rows, model, p, "row offsets inside a frame",
                    "Channels that are read out in one row group share their offset. Empty where a "
                    "channel shows no row noise (two standard errors).",
                    p.row_correlation, channels_with_rows(p));
    if (n < 2 || p.mu.covariance.n != n) continue;
    std::vector<int> partners{1, n / 4, n / 2, n - 1};
    partners.erase(std::unique(partners.begin(), partners.end()), partners.end());
    for (const int partner : partners)
      if (partner > 0)
        pairs.push_back({fmt::format("{}: {} – {}", p.gain.text(), model.layout.channel_name(0),
                                     model.layout.channel_name(partner)),
                         pair_chart(model, p, 0, partner)});
  }
  std::vector<Block> blocks;
  add_charts(blocks, std::move(mu));
  add_charts(blocks, std::move(sigma));
  add_charts(blocks, std::move(rows));
  add_charts(blocks, std::move(pairs));
  return blocks;
}

}  // namespace malus::app
