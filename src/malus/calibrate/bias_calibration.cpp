#include "malus/calibrate/bias_calibration.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/across_frames.h"
#include "malus/calibrate/bias_checks.h"
#include "malus/calibrate/fixed_pattern.h"
#include "malus/calibrate/row_drift_fit.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr double kCellsPerDeviation = 24.0;
constexpr double kNormalLambda = 0.14;
// Below: the mean of the other frames, whose error is taken for normal, has tails of its own where
// the fixed pattern is strong enough to need it.
constexpr int kFewFrames = 10;
constexpr int kDarkPairs = 8;  // of frames, to compare neighbours
constexpr double kHeavyLambda = 0.05;

// All bias frames of one gain, one entry per frame: a few kilobytes each, whatever the frame's
// size.
struct BiasFrames {
  FrameSeries mean, pixel, row, column, total, row_offset;
  std::vector<std::vector<ResidualHistogram>> residuals;  ///< [frame][channel]

  void add(FrameComponents&& frame) {
    std::vector<double> sum(frame.mean_dn.size());
    for (std::size_t c = 0; c < sum.size(); ++c)
      sum[c] =
          frame.pixel_variance_dn2[c] + frame.row_variance_dn2[c] + frame.column_variance_dn2[c];
    mean.push_back(std::move(frame.mean_dn));
    pixel.push_back(std::move(frame.pixel_variance_dn2));
    row.push_back(std::move(frame.row_variance_dn2));
    column.push_back(std::move(frame.column_variance_dn2));
    total.push_back(std::move(sum));
    row_offset.push_back(std::move(frame.row_offset_dn));
    residuals.push_back(std::move(frame.residuals));
  }
};

std::vector<double> mean_over_frames(const FrameSeries& series) {
  std::vector<double> mean(series.front().size(), 0.0);
  for (const auto& frame : series)
    for (std::size_t c = 0; c < mean.size(); ++c)
      mean[c] += frame[c] / static_cast<double>(series.size());
  return mean;
}

// Sampling error of one frame's estimates, from the components themselves: row noise is shared by
// the channels of a row group, pixel and column noise are not.
struct SamplingErrors {
  SquareMatrix mean, row, column, total;
};

SamplingErrors sampling_errors(const MosaicGeometry& geometry, const BiasFrames& frames,
                               const SquareMatrix& row_covariance, const RowDrift& drift) {
  const int n = geometry.channels();
  SamplingErrors e{SquareMatrix(n), SquareMatrix(n), SquareMatrix(n), SquareMatrix(n)};
  const auto pixel = mean_over_frames(frames.pixel), column = mean_over_frames(frames.column);
  for (int a = 0; a < n; ++a) {
    const auto pixels = static_cast<double>(geometry.channel_pixels(a));
    const double groups = geometry.channel_groups(a), cols = geometry.channel_cols(a),
                 rows = geometry.channel_rows(a), in_group = geometry.pixels_per_group(a);
    const double var = pixel[as_index(a)], col_var = std::max(column[as_index(a)], 0.0);
    const double freedom = pixels - groups - cols + 1.0;
    for (int b = 0; b < n; ++b) {
      double shared = a == b ? std::max(row_covariance(a, a), 0.0) : row_covariance(a, b);
      const double slow =
          std::sqrt(std::max(row_covariance(a, a), 0.0) * std::max(row_covariance(b, b), 0.0));
      const int n_groups = geometry.channel_groups(a), stride = geometry.group_stride(a),
                shift = geometry.group_phase(b) - geometry.group_phase(a);
      e.mean(a, b) = (shared + slow * drift_of_means(drift, n_groups, stride, shift)) / groups;
      if (a == b) shared += var / in_group;
      e.row(a, b) =
          2.0 *
          (shared * shared + slow * slow * drift_of_variances(drift, n_groups, stride, shift)) /
          (groups - 1.0);
    }
    e.mean(a, a) += var / pixels + col_var / cols;
    e.row(a, a) += 2.0 * var * var / (in_group * in_group * freedom);
    e.column(a, a) = 2.0 * std::pow(col_var + var / rows, 2) / (cols - 1.0);
    e.total(a, a) = 2.0 * var * var / pixels + e.row(a, a) + e.column(a, a);
  }
  return e;
}

// Per-frame shape and scale of one channel.
struct ChannelShapes {
  std::vector<double> lambda, scale;
  double lambda_sampling = 0, scale_sampling = 0;
};

ChannelShapes likelihood_shapes(const BiasFrames& frames, int channel,
                                const ResidualHistogram& pooled, const ResidualBlur& blur,
                                const TukeyFit& fit) {
  ChannelShapes shapes;
  const FrameShapes one_step(fit, pooled, blur);
  for (const auto& frame : frames.residuals) {
    const auto shape = one_step.of(frame[as_index(channel)]);
    shapes.lambda.push_back(shape.lambda);
    shapes.scale.push_back(fit.scale_dn * (1.0 + shape.log_scale - std::log(fit.scale_dn)));
  }
  const auto samples =
      static_cast<double>(pooled.count()) / static_cast<double>(frames.residuals.size());
  shapes.lambda_sampling = fit.unit_covariance[0] / samples;
  shapes.scale_sampling = fit.scale_dn * fit.scale_dn * fit.unit_covariance[2] / samples;
  return shapes;
}

ChannelShapes ppcc_shapes(const BiasFrames& frames, int channel, const ResidualBlur& blur) {
  ChannelShapes shapes;
  for (const auto& frame : frames.residuals) {
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

// The histogram's cells divide the converter's step, or are a whole number of steps wide. Where no
// fixed pattern spreads the offsets, residuals lie on a lattice: beside cells of any other width it
// makes a moiré that looks like another shape (λ by up to 0.005), and differs between sessions.
double cell_of(double deviation_dn, double step_dn) {
  const double width = deviation_dn / kCellsPerDeviation;
  if (!(width > 0)) return 1.0;
  if (!(step_dn > 0)) return width;
  return width < step_dn ? step_dn / std::ceil(step_dn / width)
                         : step_dn * std::floor(width / step_dn);
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

void append_nearly_normal(const std::string& channel, const std::string& reason,
                          double read_variance_dn2, std::size_t frames, PhysicsCalibration& out) {
  append_unknown(kNormalLambda,
                 std::sqrt(std::max(read_variance_dn2, 0.0) / tukey_lambda_variance(kNormalLambda)),
                 out);
  out.warnings.push_back(
      fmt::format("{}: shape of the read noise is not known ({}); taken as nearly normal, λ = {}",
                  channel, reason, kNormalLambda));
  append_frames({}, frames, out.lambda);
  append_frames({}, frames, out.sigma_tl);
}

void measure_shapes(const BiasFrames& frames, const FrameAnalyzer& analyzer, double quantization_dn,
                    double kept, const CalibrationSettings& settings, const SensorLayout& layout,
                    PhysicsCalibration& out) {
  const std::vector<double> pixel = mean_over_frames(frames.pixel);
  const std::size_t count = frames.residuals.size();
  for (int c = 0; c < layout.channels(); ++c) {
    ResidualHistogram pooled(frames.residuals.front()[as_index(c)].cell_dn());
    for (const auto& frame : frames.residuals) pooled.add(frame[as_index(c)]);
    keep_residuals(pooled, out);
    const ResidualBlur blur{quantization_dn,
                            analyzer.offset_variance_dn2(c, std::max(pixel[as_index(c)], 0.0))};
    const auto fit = fit_tukey_lambda(pooled, blur);
    const bool ppcc = settings.shape == "ppcc";
    ChannelShapes shapes;
    if (fit)
      shapes =
          ppcc ? ppcc_shapes(frames, c, blur) : likelihood_shapes(frames, c, pooled, blur, *fit);
    const std::string unknown = !fit ? fit.reason() : ppcc ? "" : runaway(shapes, *fit);
    if (!unknown.empty()) {
      append_nearly_normal(layout.channel_name(c), unknown,
                           pixel[as_index(c)] - quantization_dn * quantization_dn / 12.0, count,
                           out);
      continue;
    }
    append_frames(shapes.lambda, count, out.lambda);
    append_frames(shapes.scale, count, out.sigma_tl);
    if (std::none_of(shapes.lambda.begin(), shapes.lambda.end(),
                     [](double value) { return std::isfinite(value); })) {
      append_unknown(fit->lambda, fit->scale_dn, out);
      continue;
    }
    append_statistics(shapes.lambda, shapes.lambda_sampling, kept, out.lambda);
    append_statistics(shapes.scale, shapes.scale_sampling, kept, out.sigma_tl);
  }
}

void warn_of_few_frames(PhysicsCalibration& out) {
  const double lambda = mean_of(out.lambda.mean);
  if (out.bias_frames < kFewFrames && lambda < kHeavyLambda)
    out.warnings.push_back(fmt::format(
        "heavy tails (λ = {:.2f}) from {} bias frames: λ and σ_TL may be off by some per "
        "cent; take 20 frames or more",
        lambda, out.bias_frames));
}

// White where the frames do not show more. What drift moves from the rows' variance in a frame to
// the frame's mean is given back to the former.
void measure_drift(const MosaicGeometry& geometry, double kept, BiasFrames& frames,
                   PhysicsCalibration& out) {
  const std::vector<double> pixel = mean_over_frames(frames.pixel);
  std::vector<double> explained;
  for (int g = 0; g < geometry.group_phases(); ++g) {
    double variance = 0, pixels = 0;
    for (int c = 0; c < geometry.channels(); ++c) {
      variance += geometry.group_pixels(g, c) * pixel[as_index(c)];
      pixels += geometry.group_pixels(g, c);
    }
    explained.push_back(kept * variance / (pixels * pixels));
  }
  const auto count = static_cast<double>(frames.row_offset.size());
  out.row_drift = fit_row_drift(frames.row_offset, explained, static_cast<int>(kept * count + 0.5))
                      .value_or({});
  for (int c = 0; c < geometry.channels(); ++c) {
    const int groups = geometry.channel_groups(c);
    const double lost =
        drift_of_means(out.row_drift.drift, groups, geometry.group_stride(c), 0) / (groups - 1.0);
    for (std::size_t f = 0; f < frames.row.size(); ++f) {
      const double given_back = frames.row[f][as_index(c)] * lost / (1.0 - lost);
      frames.row[f][as_index(c)] += given_back;
      frames.total[f][as_index(c)] += given_back;
    }
  }
}

void fill_components(const BiasFrames& frames, const MosaicGeometry& geometry,
                     const SquareMatrix& row_covariance, double kept, PhysicsCalibration& out) {
  const SamplingErrors sampling =
      sampling_errors(geometry, frames, row_covariance, out.row_drift.drift);
  out.mu = frame_statistics(frames.mean, sampling.mean);
  out.sigma_row = deviation_statistics(frames.row, sampling.row, kept);
  out.sigma_column = deviation_statistics(frames.column, sampling.column, kept);
  out.sigma_column.covariance = SquareMatrix();
  out.temporal_sd_dark_dn.clear();
  for (double variance : mean_over_frames(frames.total))
    out.temporal_sd_dark_dn.push_back(std::sqrt(std::max(variance, 0.0)));
  out.temporal_sd_dark_stderr_dn =
      deviation_statistics(frames.total, sampling.total, kept).standard_error;
  out.row_correlation = nearest_correlation(correlation_of(row_covariance));
}

// What is known of a pixel's offset before its own frames are looked at: how the others' lie.
void expect_offsets(const DarkPass& dark, const OrdinaryPixels& ordinary, int frames,
                    FrameAnalyzer& analyzer) {
  const std::vector<double> temporal = dark.temporal.variance_dn2();
  Moments rows;
  for (int r = 0; r < dark.rows.rows(); ++r) rows.add(dark.rows.covariance_dn2(r, 0));
  const double row = std::max(rows.mean() - mean_of(temporal) / dark.rows.cols(), 0.0);
  const std::vector<double> pattern = dsnu_dn(ordinary.variance_dn2, temporal, frames);
  std::vector<OffsetSpread> spread;
  for (std::size_t c = 0; c < temporal.size(); ++c)
    spread.push_back(
        {ordinary.mean_dn[c], pattern[c] * pattern[c], row, std::max(temporal[c] - row, 0.0)});
  analyzer.expect(spread);
}

void add_black(const RawFrame& first, Image& dn) {
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c) dn(r, c) += static_cast<float>(first.black_at(r, c));
}

}  // namespace

DarkPass measure_dark(const FrameSet& set, const RawFrame& first, Progress& progress) {
  const MosaicGeometry geometry(first.layout, first.dn.rows(), first.dn.cols(), 1);
  DarkPass pass{TemporalAccumulator(geometry, first.black_dn, FrameAlignment::kAdditive),
                RowLagAccumulator(geometry),
                std::vector<double>(first.black_dn.size(), 0.0),
                {},
                NeighbourCorrelation(geometry)};
  EqualValues equal(geometry);
  FramePairs pairs(pass.neighbours, {}, kDarkPairs);
  bool cut_at_zero = true;  // not where black is subtracted already
  for_each_frame(set, &first, progress, [&](const RawFrame& frame, int) {
    pass.temporal.add(frame.dn);
    equal.add(frame.dn);
    pairs.add(frame.dn);
    pass.rows.add(frame.dn, channel_means(frame.dn, geometry));
    for (int r = 0; r < geometry.rows(); ++r)
      for (int c = 0; c < geometry.cols(); ++c) {
        if (frame.dn(r, c) < 0.0F) cut_at_zero = false;
        if (frame.dn(r, c) <= 0.0F) pass.zero_share[as_index(geometry.channel(r, c))] += 1.0;
      }
  });
  pass.constancy = equal.chance_of_constancy();
  if (!cut_at_zero) pass.zero_share.assign(pass.zero_share.size(), 0.0);
  for (int c = 0; c < geometry.channels(); ++c)
    pass.zero_share[as_index(c)] /=
        static_cast<double>(geometry.channel_pixels(c)) * std::max(set.count, 1);
  return pass;
}

void measure_bias(const FrameSet& set, const RawFrame& first, DarkPass& dark, RowGroup row_group,
                  double quantization_dn, const CalibrationSettings& settings, Progress& progress,
                  PhysicsCalibration& out) {
  const MosaicGeometry geometry(first.layout, first.dn.rows(), first.dn.cols(), row_group.rows);
  out.bias_frames = set.count;
  const bool several = set.count >= 2, remove_pattern = !settings.single_frame && several;
  Image pattern = dark.temporal.release_mean_frame_dn();
  add_black(first, pattern);
  std::vector<double> cell =
      remove_pattern ? dark.temporal.variance_dn2() : channel_variances(first.dn, geometry);
  for (double& width : cell) width = cell_of(std::sqrt(std::max(width, 0.0)), quantization_dn);
  FrameAnalyzer analyzer(geometry, first.black_dn, remove_pattern ? &pattern : nullptr, set.count,
                         cell);
  const OrdinaryPixels ordinary =
      ordinary_pixels(pattern, several ? 0.0 : quantization_dn, geometry);
  if (remove_pattern) expect_offsets(dark, ordinary, set.count, analyzer);
  BiasFrames frames;
  for_each_frame(set, &first, progress,
                 [&](const RawFrame& frame, int) { frames.add(analyzer.analyze(frame.dn)); });
  const double kept = remove_pattern ? 1.0 - 1.0 / set.count : 1.0;
  if (row_group.known && remove_pattern) measure_drift(geometry, kept, frames, out);
  // Hot pixels are as bright in every frame as in their mean.
  const std::vector<double> all = channel_means(pattern, geometry);
  for (std::vector<double>& frame : frames.mean)
    for (std::size_t c = 0; c < all.size(); ++c) frame[c] += ordinary.mean_dn[c] - all[c];
  fill_components(frames, geometry, analyzer.row_covariance_dn2(), kept, out);
  measure_shapes(frames, analyzer, quantization_dn, kept, settings, first.layout, out);
  if (remove_pattern) warn_of_few_frames(out);
  const double temporal_sd = mean_of(out.temporal_sd_dark_dn);
  warn_of_drift(frames.mean, temporal_sd, out);
  warn_of_outlying_frames(frames.mean, temporal_sd, out);
  warn_of_outlying_noise(frames.residuals, out);
  warn_of_high_level(first, out);
  warn_of_clipping(dark.zero_share, first.layout, out);
  warn_of_coarse_steps(quantization_dn, out);
  warn_of_column_noise(out);
  if (!several) return;
  const std::vector<double> temporal = dark.temporal.variance_dn2();
  out.dsnu_dn = dsnu_dn(ordinary.variance_dn2, temporal, set.count);
  subtract_levels(pattern, ordinary.mean_dn, geometry);
  out.dark_shading_dn = std::move(pattern);
  // The mean over a finite number of pixels cannot tell a channel's bias from its fixed pattern.
  for (std::size_t c = 0; c < out.dsnu_dn.size(); ++c)
    out.mu.standard_error[c] = std::hypot(
        out.mu.standard_error[c],
        out.dsnu_dn[c] /
            std::sqrt(static_cast<double>(geometry.channel_pixels(static_cast<int>(c)))));
  warn_of_light(out.dark_shading_dn, geometry, temporal_sd, out);
}

}  // namespace malus
