#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/noise/residual_law.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>

#include "report_plots.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

// One regression of the joint model: what is plotted, and where its numbers lie.
struct Law {
  std::string title, symbol, unit;
  ChannelStatistics PhysicsCalibration::*measured;
  std::vector<LogLinear> JointSegment::*lines;
  std::vector<double> GainParameters::*between;  // what the joint model makes of the lines
  double sign;
};

PointSeries measured_points(const NoiseModel& model, const Law& law, int channel) {
  const std::string name = model.layout.channel_name(channel);
  PointSeries points{.name = name, .mark = Mark::kPoints, .tone = name};
  for (const PhysicsCalibration& p : model.physics) {
    const ChannelStatistics& s = p.*law.measured;
    if (p.K.mean.empty() || s.mean.empty()) continue;
    points.x.push_back(mean_of(p.K.mean));
    points.y.push_back(law.sign * s.mean[as_index(channel)]);
    const bool known = as_index(channel) < s.standard_error.size() &&
                       std::isfinite(s.standard_error[as_index(channel)]);
    points.error.push_back(known ? s.standard_error[as_index(channel)] : 0.0);
    points.notes.push_back(p.gain.text());
  }
  return points;
}

using Curve = std::vector<GainParameters>;

// What the joint model gives at the knots of a segment and between them.
Curve model_curve(const JointSegment& segment) {
  constexpr int kPoints = 24;  // over the segment; more where it has more gains
  const std::vector<double>& knots = segment.knots_db;
  Curve curve{joint_parameters(segment, knots.front())};
  for (std::size_t i = 1; i < knots.size(); ++i) {
    const int steps = 1 + kPoints / static_cast<int>(knots.size());
    for (int k = 1; k <= steps; ++k)
      curve.push_back(
          joint_parameters(segment, knots[i - 1] + (knots[i] - knots[i - 1]) * k / steps));
  }
  return curve;
}

// One law of it, one series per channel.
void add_curves(const Curve& curve, const SensorLayout& layout, const Law& law, Chart& chart) {
  for (int channel = 0; channel < layout.channels(); ++channel) {
    const std::string name = layout.channel_name(channel);
    PointSeries line{.name = name + ", model", .mark = Mark::kLine, .tone = name};
    for (const GainParameters& p : curve) {
      line.x.push_back(mean_of(p.K));
      line.y.push_back(law.sign * (p.*law.between)[as_index(channel)]);
    }
    chart.series.emplace_back(std::move(line));
  }
}

// Whether a logarithmic axis has no place for one: a row noise of 0, a bias above it.
bool is_shown_linearly(const Chart& chart) {
  return std::ranges::any_of(chart.series, [](const Series& series) {
    return std::ranges::any_of(std::get<PointSeries>(series).y, [](double y) { return y <= 0; });
  });
}

// curves: of the joint model's segments.
Chart law_chart(const NoiseModel& model, const std::vector<Curve>& curves, const Law& law) {
  Chart chart{law.title + " over gain",
              "Measured values with standard errors, and what the joint model gives between them: "
              "its law (Eq. 7) with the part of the residuals that errors do not explain. "
              "The horizontal axis is the mean gain of the channels.",
              {"mean gain K̂", "DN/e-", AxisScale::kLogarithmic},
              {law.symbol, law.unit, AxisScale::kLogarithmic},
              {}};
  for (int channel = 0; channel < model.layout.channels(); ++channel)
    chart.series.emplace_back(measured_points(model, law, channel));
  if (is_shown_linearly(chart)) chart.y.scale = AxisScale::kLinear;
  if (!model.joint) return chart;
  for (const JointSegment& segment : model.joint->segments)
    if (std::ranges::any_of(segment.*law.lines, &LogLinear::signed_linear))
      chart.y.scale = AxisScale::kLinear;
  for (const Curve& curve : curves) add_curves(curve, model.layout, law, chart);
  return chart;
}

// Density of the residuals of one channel on both sides of zero, in bins a quarter of the standard
// deviation wide, and the two laws.
struct Distribution {
  PointSeries measured{.name = "measured", .mark = Mark::kBars, .tone = ""};
  PointSeries normal{.name = "Gaussian", .mark = Mark::kDashed};
  PointSeries tukey{.name = "Tukey lambda", .mark = Mark::kLine};
};

double residual_deviation(const std::vector<double>& counts, double cell_dn) {
  double total = 0, squares = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const double centre = (static_cast<double>(i) + 0.5) * cell_dn;
    total += counts[i];
    squares += counts[i] * centre * centre;
  }
  return total > 0 ? std::sqrt(squares / total) : 0;
}

// The fitted law, and normal noise whose residuals have the measured deviation, both as residuals
// show them: in steps of the converter, about offsets that are known as well as frames allow. (Set
// beside the bare law, noise of half a step looked 20 % too wide where its fit was right.)
struct Laws {
  ResidualLaw tukey, normal;
};

Laws laws_of(const NoiseModel& model, const PhysicsCalibration& p, int channel, double sd_dn) {
  const std::size_t c = as_index(channel);
  constexpr double kLeastScale = 1e-6;  // a model may have no read noise at all
  const double lambda = p.lambda.mean[c], scale_dn = std::max(p.sigma_tl.mean[c], kLeastScale);
  const double q = model.quantization_dn;
  const double rounding_dn2 = q * q / 12, read_dn = tukey_lambda_deviation(scale_dn, lambda);
  const double pixel_dn2 = read_dn * read_dn + rounding_dn2;
  // The offset comes from the other frames, drawn towards the channel's mean by what pixels differ.
  const double pattern_dn2 = c < p.dsnu_dn.size() ? p.dsnu_dn[c] * p.dsnu_dn[c] : 0;
  ResidualBlurring blur{q, 0};
  if (pattern_dn2 > 0)
    blur.offset_variance_dn2 = 1 / (1 / pattern_dn2 + (p.bias_frames - 1) / pixel_dn2);
  const double normal_dn2 = sd_dn * sd_dn - rounding_dn2 - blur.offset_variance_dn2;
  const double least_dn2 = kLeastScale * pixel_dn2;
  return {ResidualLaw::tukey(lambda, scale_dn, blur),
          ResidualLaw::normal(std::sqrt(normal_dn2 > least_dn2 ? normal_dn2 : least_dn2), blur)};
}

Distribution distribution_of(const NoiseModel& model, const PhysicsCalibration& p, int channel) {
  const std::vector<double>& counts = p.residual_counts[as_index(channel)];
  const double cell = p.residual_cell_dn[as_index(channel)];
  double total = 0;
  for (const double count : counts) total += count;
  const double sd = residual_deviation(counts, cell);
  // The converter's step shows in cells finer than it: bins are a DN or a quarter deviation wide, a
  // DN where counts are beyond what has a deviation.
  const auto merged =
      static_cast<std::size_t>(std::clamp(std::ceil(std::max(1.0, 0.25 * sd) / cell), 1.0,
                                          std::max(1.0, static_cast<double>(counts.size()))));
  const double width = static_cast<double>(merged) * cell;
  Distribution d;
  std::vector<std::pair<double, double>> half;
  for (std::size_t i = 0; i + merged < counts.size(); i += merged) {
    double in_bin = 0;
    for (std::size_t k = i; k < i + merged; ++k) in_bin += counts[k];
    if (in_bin > 0)
      half.emplace_back((static_cast<double>(i) / static_cast<double>(merged) + 0.5) * width,
                        in_bin / (2 * total * width));
  }
  for (auto from = half.rbegin(); from != half.rend(); ++from) {
    d.measured.x.push_back(-from->first);
    d.measured.y.push_back(from->second);
  }
  for (const auto& [x, y] : half) {
    d.measured.x.push_back(x);
    d.measured.y.push_back(y);
  }
  const double reach = half.empty() ? 1 : half.back().first;
  const Laws laws = laws_of(model, p, channel, sd);
  constexpr int kPoints = 80;
  for (int i = -kPoints; i <= kPoints; ++i) {
    const double x = reach * i / kPoints;
    d.normal.x.push_back(x);
    d.normal.y.push_back(laws.normal.density(x, width));
    d.tukey.x.push_back(x);
    d.tukey.y.push_back(laws.tukey.density(x, width));
  }
  const double least = 0.3 / (2 * total * cell);
  for (PointSeries* curve : {&d.normal, &d.tukey})
    for (double& y : curve->y)
      if (y < least) y = Measured::kNone;  // far below what one count would show
  return d;
}

// Where a law has these shares of residuals above it, which fall. Interpolated in the logarithm of
// its own shares at rising distances.
std::vector<double> quantiles_above(const ResidualLaw& law, const std::vector<double>& shares,
                                    double step_dn) {
  std::vector<double> quantiles;
  double low_dn = 0, low_share = law.above(0), high_dn = step_dn, high_share = law.above(high_dn);
  for (const double share : shares) {
    constexpr double kGrowth = 1.02;  // of the steps, beyond the first
    while (high_share > share && high_dn < 1e6 * step_dn) {
      low_dn = high_dn;
      low_share = high_share;
      high_dn = std::max(high_dn + step_dn, kGrowth * high_dn);
      high_share = law.above(high_dn);
    }
    // A bounded law has nothing above its end.
    const double part = high_share > 0
                            ? std::log(low_share / share) / std::log(low_share / high_share)
                            : (low_share - share) / low_share;
    quantiles.push_back(low_dn + part * (high_dn - low_dn));
  }
  return quantiles;
}

// Ordered residuals against quantiles: a straight line where the law holds.
Chart probability_chart(const NoiseModel& model, const PhysicsCalibration& p, int channel,
                        const std::string& name) {
  Chart chart{
      title_at("Probability plot of " + name, p.gain),
      "Measured quantiles of the residuals against those of the fitted Tukey lambda and of "
      "a Gaussian of the same standard deviation, both rounded in steps as the codes are. A "
      "law that holds lies on the line.",
      {"quantile of the law", "DN"},
      {"measured quantile", "DN"},
      {}};
  const std::vector<double>& counts = p.residual_counts[as_index(channel)];
  const double cell = p.residual_cell_dn[as_index(channel)];
  const double sd = residual_deviation(counts, cell);
  double total = 0, below = 0;
  for (const double count : counts) total += count;
  std::vector<double> edges, shares;
  for (std::size_t i = 0; i + 1 < counts.size(); ++i) {
    below += counts[i];
    if (counts[i] == 0) continue;
    edges.push_back(static_cast<double>(i + 1) * cell);
    shares.push_back(0.5 - 0.5 * below / (total + 1));
  }
  const Laws laws = laws_of(model, p, channel, sd);
  PointSeries tukey{.name = "Tukey lambda", .mark = Mark::kPoints},
      normal{.name = "Gaussian", .mark = Mark::kPoints};
  for (const auto& [series, law] :
       {std::pair(&tukey, &laws.tukey), std::pair(&normal, &laws.normal)}) {
    const std::vector<double> quantiles = quantiles_above(*law, shares, cell);
    for (std::size_t i = 0; i < edges.size(); ++i)
      for (const double side : {-1.0, 1.0}) {
        series->x.push_back(side * quantiles[i]);
        series->y.push_back(side * edges[i]);
      }
  }
  PointSeries diagonal{.name = "equal", .mark = Mark::kLine};
  const double reach = tukey.y.empty() ? 1 : tukey.y.back();
  diagonal.x = diagonal.y = {-reach, reach};
  chart.series = {tukey, normal, diagonal};
  return chart;
}

// One channel per colour: sixteen would look alike.
std::vector<int> one_per_color(const SensorLayout& layout) {
  std::vector<int> chosen;
  for (const Color color : layout.colors())
    for (int channel = 0; channel < layout.channels(); ++channel)
      if (layout.site(channel).color == color) {
        chosen.push_back(channel);
        break;
      }
  return chosen;
}

}  // namespace

std::vector<Block> law_plots(const NoiseModel& model) {
  std::vector<Block> blocks;
  const std::vector<Law> laws = {
      {"Read noise scale σ_TL", "σ_TL", "DN", &PhysicsCalibration::sigma_tl,
       &JointSegment::sigma_tl, &GainParameters::sigma_tl_dn, 1},
      {"Row noise σ_b", "σ_b", "DN", &PhysicsCalibration::sigma_row, &JointSegment::sigma_row,
       &GainParameters::sigma_row_dn, 1},
      {"Negative bias −μ", "−μ", "DN", &PhysicsCalibration::mu, &JointSegment::minus_mu,
       &GainParameters::mu_dn, -1}};
  if (model.physics.size() < 2) return blocks;
  std::vector<Curve> curves;
  if (model.joint)
    for (const JointSegment& segment : model.joint->segments)
      curves.push_back(model_curve(segment));
  for (const Law& law : laws)
    blocks.emplace_back(ChartsBlock{"", {{"", law_chart(model, curves, law)}}});
  return blocks;
}

std::vector<Block> distribution_plots(const NoiseModel& model) {
  Variants densities, probabilities;
  for (const PhysicsCalibration& p : model.physics) {
    if (p.residual_counts.empty()) continue;
    for (const int channel : one_per_color(model.layout)) {
      const std::string name = model.layout.channel_name(channel);
      const Distribution d = distribution_of(model, p, channel);
      Chart chart{title_at("Read noise of " + name, p.gain),
                  fmt::format("Residuals of {} bias frames after row noise and fixed pattern, "
                              "against the fitted Tukey lambda (λ = {:.3f}) and a Gaussian of the "
                              "same standard deviation, both rounded in steps as the codes are.",
                              p.bias_frames, p.lambda.mean[as_index(channel)]),
                  {"residual", "DN"},
                  {"density", "1/DN", AxisScale::kLogarithmic},
                  {}};
      chart.series = {d.measured, d.normal, d.tukey};
      const std::string label = fmt::format("{}, {}", p.gain.text(), name);
      densities.push_back({label, std::move(chart)});
      probabilities.push_back({label, probability_chart(model, p, channel, name)});
    }
  }
  std::vector<Block> blocks;
  for (Variants* variants : {&densities, &probabilities})
    if (!variants->empty())
      blocks.emplace_back(ChartsBlock{"Gain and channel", std::move(*variants)});
  return blocks;
}

}  // namespace malus::app
