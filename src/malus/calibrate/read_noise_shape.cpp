#include "malus/calibrate/internal/read_noise_shape.h"

#include "malus/base/index.h"
#include "malus/base/log_gamma.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/internal/across_frames.h"
#include "malus/calibrate/internal/channel_words.h"
#include "malus/calibrate/internal/tukey_fit.h"
#include "malus/noise/physics.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include <fmt/format.h>

namespace malus {
namespace {

struct Value {
  double mean = 0, error = 0;
};

// Per-frame shape and scale of one channel.
struct ChannelShapes {
  std::vector<double> lambda, scale;
  double lambda_sampling = 0, scale_sampling = 0;
};

ChannelShapes likelihood_shapes(const ShapeInput& in, int channel, const ResidualHistogram& pooled,
                                const ResidualBlur& blur, const TukeyFit& fit) {
  ChannelShapes shapes;
  const FrameShapes one_step(fit, pooled, blur);
  for (const auto& frame : in.residuals) {
    const auto shape = one_step.of(frame[as_index(channel)]);
    shapes.lambda.push_back(shape.lambda);
    shapes.scale.push_back(fit.scale_dn * (1.0 + shape.log_scale - std::log(fit.scale_dn)));
  }
  const auto samples = pooled.count() / static_cast<double>(in.residuals.size());
  shapes.lambda_sampling = fit.unit_covariance[0] / samples;
  shapes.scale_sampling = fit.scale_dn * fit.scale_dn * fit.unit_covariance[2] / samples;
  return shapes;
}

ChannelShapes ppcc_shapes(const ShapeInput& in, int channel, const ResidualBlur& blur) {
  ChannelShapes shapes;
  for (const auto& frame : in.residuals) {
    const auto fit = fit_tukey_lambda_ppcc(frame[as_index(channel)], blur);
    const double nan = std::numeric_limits<double>::quiet_NaN();
    shapes.lambda.push_back(fit ? fit->lambda : nan);
    shapes.scale.push_back(fit ? fit->scale_dn : nan);
  }
  return shapes;
}

// One more channel; frames without an estimate have NaN.
void append_frames(const std::vector<double>& values, std::size_t frames, ChannelStatistics& out) {
  out.per_frame.resize(frames);
  for (std::size_t f = 0; f < frames; ++f)
    out.per_frame[f].push_back(f < values.size() ? values[f]
                                                 : std::numeric_limits<double>::quiet_NaN());
}

void append_statistics(const std::vector<double>& values, double sampling, double kept,
                       ChannelStatistics& out) {
  FrameSeries series;
  for (double value : values)
    if (std::isfinite(value)) series.push_back({value});
  SquareMatrix error(1);
  error(0, 0) = sampling;
  const ChannelStatistics one = frame_statistics(series, error, kept);
  out.mean.push_back(one.mean[0]);
  out.standard_error.push_back(one.standard_error[0]);
  out.spread.push_back(one.spread[0]);
}

void append_unknown(double lambda, double scale, PhysicsCalibration& out) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  out.lambda.mean.push_back(lambda);
  out.sigma_tl.mean.push_back(scale);
  for (ChannelStatistics* statistics : {&out.lambda, &out.sigma_tl}) {
    statistics->standard_error.push_back(nan);
    statistics->spread.push_back(0.0);
  }
}

// For the report's distribution plot: twelve deviations are enough to see every tail that matters,
// of cells that may be half as wide as they were meant.
void keep_residuals(const ResidualHistogram& pooled, PhysicsCalibration& out) {
  constexpr std::size_t kCells = static_cast<std::size_t>(2 * 12 * kCellsPerDeviation);
  std::vector<double> counts(kCells, 0.0);
  for (const ResidualHistogram::Cell& cell : pooled.cells())
    counts[std::min(as_index(cell.index), kCells - 1)] += cell.count;
  out.residual_cell_dn.push_back(pooled.cell_dn());
  out.residual_counts.push_back(std::move(counts));
}

// Where the likelihood is all but flat, one Newton step leads anywhere, and so does the mean of
// many: λ of 132 or 6704 was stored. Not empty: why the frames' values say nothing.
std::string runaway(const ChannelShapes& shapes, const TukeyFit& fit) {
  constexpr double kOfFit = 0.05;  // they are the pooled fit but for rounding
  const double lambda = mean_of(shapes.lambda), scale = mean_of(shapes.scale);
  const double error =
      std::sqrt(shapes.lambda_sampling / static_cast<double>(shapes.lambda.size()));
  if (std::abs(lambda - fit.lambda) < kOfFit && std::abs(scale / fit.scale_dn - 1.0) < kOfFit &&
      error < kLambdaHigh - kLambdaLow)
    return {};
  return fmt::format("the frames do not determine it: λ = {:.2f} ± {:.2g}", fit.lambda, error);
}

void append_nearly_normal(double read_variance_dn2, std::size_t frames, PhysicsCalibration& out) {
  append_unknown(kNormalLambda,
                 std::sqrt(std::max(read_variance_dn2, 0.0) / tukey_lambda_variance(kNormalLambda)),
                 out);
  append_frames({}, frames, out.lambda);
  append_frames({}, frames, out.sigma_tl);
}

// Scale of the law with that variance, and its error.
Value scale_of_variance(const Value& lambda, const Value& variance_dn2) {
  constexpr double kStep = 1e-3;  // of λ
  const double of_shape = tukey_lambda_variance(lambda.mean);
  const double by_lambda =
      0.5 * (tukey_lambda_variance(lambda.mean + kStep) - of_shape) / (kStep * of_shape);
  const double scale = std::sqrt(std::max(variance_dn2.mean, 0.0) / of_shape);
  return {scale, scale * std::hypot(0.5 * variance_dn2.error / variance_dn2.mean,
                                    by_lambda * lambda.error)};
}

// Shape of the law that tells what was cut off, with the variance that it has without offsets.
void append_law(const CutOffNoise& cut, double read_variance_dn2, std::size_t frames,
                PhysicsCalibration& out) {
  const Value scale = scale_of_variance({cut.lambda, cut.lambda_stderr},
                                        {read_variance_dn2, cut.variance_stderr_dn2});
  append_unknown(cut.lambda, scale.mean, out);
  out.lambda.standard_error.back() = cut.lambda_stderr;
  if (read_variance_dn2 > 0) out.sigma_tl.standard_error.back() = scale.error;
  append_frames({}, frames, out.lambda);
  append_frames({}, frames, out.sigma_tl);
}

// Not empty: what is said of noise that the step hides, of which this variance is kept.
std::string hidden_words(const HiddenNoise& hidden) {
  if (!hidden.hidden) return {};
  if (hidden.unknown.empty())
    return fmt::format(
        "the dark noise is hidden by the converter's step; from how often pixels change their code "
        "it is {:.3g} ± {:.2g} DN, taken as normal",
        std::sqrt(hidden.variance_dn2),
        0.5 * hidden.variance_stderr_dn2 / std::sqrt(hidden.variance_dn2));
  return fmt::format(
      "the dark noise is hidden by the converter's step and not known ({}); its upper limit, "
      "{:.2g} "
      "DN (EMVA 1288), is kept",
      hidden.unknown, std::sqrt(hidden.limit_dn2));
}

double hidden_read_dn2(const HiddenNoise& hidden, double row_dn) {
  return (hidden.unknown.empty() ? hidden.variance_dn2 : hidden.limit_dn2) - row_dn * row_dn;
}

void measure_shape(const ShapeInput& in, int c, const std::string& name, ChannelTroubles& troubles,
                   PhysicsCalibration& out) {
  const double pixel = in.pixel_variance_dn2[as_index(c)];
  const std::size_t count = in.residuals.size();
  const ResidualHistogram pooled = pooled_over_frames(in.residuals, as_index(c));
  keep_residuals(pooled, out);
  const HiddenNoise hidden = in.hidden.empty() ? HiddenNoise{} : in.hidden[as_index(c)];
  if (hidden.hidden && pixel > 0) {
    append_nearly_normal(hidden_read_dn2(hidden, out.sigma_row.mean[as_index(c)]), count, out);
    troubles.add(name, hidden_words(hidden));
    return;
  }
  const double rounding_dn2 = in.quantization_dn * in.quantization_dn / 12.0;
  if (as_index(c) < in.cut_off.size() && in.cut_off[as_index(c)].by_law) {
    append_law(in.cut_off[as_index(c)], pixel - rounding_dn2, count, out);
    return;
  }
  const ResidualBlur blur{in.quantization_dn,
                          in.analyzer.offset_variance_dn2(c, std::max(pixel, 0.0))};
  const auto fit = fit_tukey_lambda(pooled, blur);
  ChannelShapes shapes;
  if (fit)
    shapes = in.ppcc ? ppcc_shapes(in, c, blur) : likelihood_shapes(in, c, pooled, blur, *fit);
  const std::string unknown = !fit ? fit.reason() : in.ppcc ? "" : runaway(shapes, *fit);
  if (!unknown.empty()) {
    append_nearly_normal(pixel - rounding_dn2, count, out);
    troubles.add(
        name,
        fmt::format("shape of the read noise is not known ({}); taken as nearly normal, λ = {}",
                    unknown, kNormalLambda));
    return;
  }
  append_frames(shapes.lambda, count, out.lambda);
  append_frames(shapes.scale, count, out.sigma_tl);
  if (std::none_of(shapes.lambda.begin(), shapes.lambda.end(),
                   [](double value) { return std::isfinite(value); })) {
    append_unknown(fit->lambda, fit->scale_dn, out);
    return;
  }
  append_statistics(shapes.lambda, shapes.lambda_sampling, in.kept, out.lambda);
  append_statistics(shapes.scale, shapes.scale_sampling, in.kept, out.sigma_tl);
}

// Fourth moment of the law over its squared second; infinite up to λ = -1/4. Above -0.05, where the
// terms cancel, that of -0.05, which is larger.
double kurtosis(double lambda) {
  const double l = std::min(lambda, -0.05);
  if (l <= -0.25) return std::numeric_limits<double>::infinity();
  const auto beta = [](double a, double b) {
    return std::exp(log_gamma(a) + log_gamma(b) - log_gamma(a + b));
  };
  const double fourth =
      2.0 / (4 * l + 1) - 8.0 * beta(3 * l + 1, l + 1) + 6.0 * beta(2 * l + 1, 2 * l + 1);
  return fourth / std::pow(l * l * tukey_lambda_variance(l), 2);
}

}  // namespace

void keep_dark_variance(double quantization_dn, PhysicsCalibration& out) {
  constexpr double kErrors = 5.0, kErrorsOfLess = 3.0, kOfVariance = 0.02;
  constexpr double kNarrow = 0.75;  // steps: what shows depends on its place in a code
  if (!out.dark_zero_share.empty()) return;
  const std::vector<double> read_dn = read_noise_dn(out);
  for (std::size_t c = 0; c < read_dn.size(); ++c) {
    const Value lambda{out.lambda.mean[c], out.lambda.standard_error[c]};
    const double row = out.sigma_row.mean[c], dark = out.temporal_sd_dark_dn[c];
    const double shown_dn2 = dark * dark - row * row - quantization_dn * quantization_dn / 12.0;
    if (!(read_dn[c] > kNarrow * quantization_dn && shown_dn2 > 0 && std::isfinite(lambda.error)))
      continue;
    const std::vector<double>& counts = out.residual_counts[c];
    const double samples =
        std::accumulate(counts.begin(), counts.end(), 0.0) * (1.0 - 1.0 / out.bias_frames);
    const double excess = read_dn[c] * read_dn[c] / shown_dn2 - 1.0;
    const double chance = std::sqrt((kurtosis(lambda.mean) - 1.0) / samples);
    const bool more = excess > std::max(kOfVariance, kErrors * chance);
    if (!more && !(-excess > kErrorsOfLess * chance)) continue;
    const Value scale = scale_of_variance(
        lambda, {shown_dn2, 2.0 * std::hypot(dark * out.temporal_sd_dark_stderr_dn[c],
                                             row * out.sigma_row.standard_error[c])});
    if (!more) {
      double& error = out.sigma_tl.standard_error[c];
      error = std::hypot(error, scale.mean - out.sigma_tl.mean[c]);
      continue;
    }
    const double less = scale.mean / out.sigma_tl.mean[c];
    for (std::vector<double>& frame : out.sigma_tl.per_frame) frame[c] *= less;
    out.sigma_tl.spread[c] *= less;
    out.sigma_tl.mean[c] = scale.mean;
    out.sigma_tl.standard_error[c] = scale.error;
  }
}

void measure_shapes(const ShapeInput& in, const SensorLayout& layout, PhysicsCalibration& out) {
  ChannelTroubles troubles;
  for (int c = 0; c < layout.channels(); ++c)
    measure_shape(in, c, layout.channel_name(c), troubles, out);
  for (std::string& line : troubles.lines(layout)) out.warnings.push_back(std::move(line));
}

double residual_cell_dn(double deviation_dn, double step_dn) {
  const double width = deviation_dn / kCellsPerDeviation;
  if (!(width > 0)) return 1.0;
  if (!(step_dn > 0)) return width;
  return width < step_dn ? step_dn / std::ceil(step_dn / width)
                         : step_dn * std::floor(width / step_dn);
}

}  // namespace malus
