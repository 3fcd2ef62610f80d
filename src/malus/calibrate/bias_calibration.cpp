#include "malus/calibrate/internal/bias_calibration.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/internal/across_frames.h"
#include "malus/calibrate/internal/bias_checks.h"
#include "malus/calibrate/internal/bias_frames.h"
#include "malus/calibrate/internal/coarse_steps.h"
#include "malus/calibrate/internal/dark_corrections.h"
#include "malus/calibrate/internal/equal_values.h"
#include "malus/calibrate/internal/fixed_pattern.h"
#include "malus/calibrate/internal/floor_check.h"
#include "malus/calibrate/internal/read_noise_shape.h"
#include "malus/calibrate/internal/row_drift_fit.h"
#include "malus/calibrate/internal/row_group.h"
#include "malus/calibrate/internal/zero_share.h"
#include "malus/image/quantization.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

// Below: the mean of the other frames, whose error is taken for normal, has tails of its own where
// the fixed pattern is strong enough to need it.
constexpr int kFewFrames = 10;
constexpr int kDarkPairs = 8;  // of frames, to compare neighbours
constexpr int kFewIndependent = 2;
constexpr double kFaintEvidence = 4.0;  // 2 ln L
constexpr double kHeavyLambda = 0.05;

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

void warn_of_few_frames(PhysicsCalibration& out) {
  const double lambda = mean_of(out.lambda.mean);
  if (out.bias_frames < kFewFrames && lambda < kHeavyLambda)
    out.warnings.push_back(fmt::format(
        "heavy tails (λ = {:.2f}) from {} bias frames: λ and σ_TL may be off by some per "
        "cent; take 20 frames or more",
        lambda, out.bias_frames));
}

// White where the frames do not show more. What drift moves from the rows' variance in a frame to
// the frame's mean is given back to the former. The result is, per channel, the relative error that
// the drift's own error gives the rows' variance so.
std::vector<double> measure_drift(const GainRun& run, double kept, BiasFrames& frames,
                                  DarkPass& dark, PhysicsCalibration& out) {
  const MosaicGeometry& geometry = run.geometry();
  if (geometry.groups() < geometry.group_phases()) {  // not every phase is seen
    dark.doubtful_drift = true;
    return std::vector<double>(as_index(geometry.channels()), 0.0);
  }
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
  const int independent = static_cast<int>(kept * count + 0.5);
  // One frame or two may show little of a drift that makes σ_b uncertain all the same.
  const double least = independent > kFewIndependent ? kRowDriftEvidence : kFaintEvidence;
  const FittedRowDrift fitted =
      fit_row_drift(frames.row_offset, explained, independent, least).value_or({});
  dark.doubtful_drift = !(fitted.evidence > kRowDriftEvidence) || !run.row_group().known;
  out.row_drift = fitted;
  std::vector<double> error;
  for (int c = 0; c < geometry.channels(); ++c) {
    const int groups = geometry.channel_groups(c);
    const double lost =
        drift_of_means(out.row_drift.drift, groups, geometry.group_stride(c), 0) / (groups - 1.0);
    for (std::size_t f = 0; f < frames.row.size(); ++f) {
      const double given_back = frames.row[f][as_index(c)] * lost / (1.0 - lost);
      frames.row[f][as_index(c)] += given_back;
      frames.total[f][as_index(c)] += given_back;
    }
    error.push_back(drift_of_means_stderr(fitted, groups, geometry.group_stride(c)) /
                    ((groups - 1.0) * (1.0 - lost)));
  }
  return error;
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

// relative: measure_drift's. Half of a variance's relative error is the deviation's.
void widen_by_drift(const std::vector<double>& relative, PhysicsCalibration& out) {
  for (std::size_t c = 0; c < relative.size(); ++c) {
    const double row = out.sigma_row.mean[c], all = out.temporal_sd_dark_dn[c];
    double& of_row = out.sigma_row.standard_error[c];
    double& of_all = out.temporal_sd_dark_stderr_dn[c];
    of_row = std::hypot(of_row, 0.5 * relative[c] * row);
    if (all > 0) of_all = std::hypot(of_all, 0.5 * relative[c] * row * row / all);
  }
}

// Hot pixels are as bright in every frame as in their mean.
void level_of_ordinary_pixels(const std::vector<double>& all_dn,
                              const std::vector<double>& ordinary_dn, BiasFrames& frames) {
  for (std::vector<double>& frame : frames.mean)
    for (std::size_t c = 0; c < all_dn.size(); ++c) frame[c] += ordinary_dn[c] - all_dn[c];
}

// What is known of a pixel's offset before its own frames are looked at: how the others' lie.
void expect_offsets(const DarkPass& dark, const OrdinaryPixels& ordinary, int frames,
                    Image constant, FrameAnalyzer& analyzer) {
  const std::vector<double> temporal = dark.temporal.variance_dn2();
  const double row =
      std::max(row_variance_of(dark.rows, mean_of(temporal), dark.rows.cols()).value_dn2, 0.0);
  // What strong row noise leaves in the mean of few frames would swamp a weak pattern: the pixels'
  // own is judged within the row groups, where rows have no part.
  std::vector<double> of_ordinary = temporal_of(ordinary, frames);
  const std::vector<double> pattern = dsnu_dn(ordinary.variance_dn2, of_ordinary, frames);
  for (double& variance : of_ordinary) variance = std::max(variance - row, 0.0);
  const std::vector<double> within = dsnu_dn(ordinary.within_groups_dn2, of_ordinary, frames);
  std::vector<OffsetSpread> spread;
  for (std::size_t c = 0; c < temporal.size(); ++c)
    spread.push_back({ordinary.mean_dn[c], pattern[c] * pattern[c], within[c] * within[c], row,
                      std::max(temporal[c] - row, 0.0)});
  analyzer.expect(spread, std::move(constant));
}

// A frame of one code shows no step; of whole numbers it is one.
double step_of(View<const float> dn, double quantization_dn) {
  if (quantization_dn > 0) return quantization_dn;
  for (int r = 0; r < dn.rows(); ++r)
    for (const float v : dn.row_span(r))
      if (v != std::floor(v)) return 0.0;
  return 1.0;
}

void add_black(const FrameFormat& format, Image& dn) {
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c) dn(r, c) += static_cast<float>(format.black_at(r, c));
}

void warn_of_dark_frames(const GainRun& run, const BiasFrames& frames, const DarkPass& dark,
                         PhysicsCalibration& out) {
  const FrameFormat& format = run.format();
  const double temporal_sd = mean_of(out.temporal_sd_dark_dn);
  warn_of_drift(frames.mean, temporal_sd, out);
  warn_of_outlying_frames(frames.mean, temporal_sd, out);
  warn_of_outlying_noise(frames.residuals, dark.hidden, run.geometry().cols(), out);
  warn_of_high_level(format, out);
  warn_of_clipping(dark.zero_share, dark.floor_code_dn, format.layout, out);
  if (dark.hidden.empty() ||
      !std::all_of(dark.hidden.begin(), dark.hidden.end(), std::mem_fn(&HiddenNoise::known)))
    warn_of_coarse_steps(dark.step_dn, out);
  warn_of_column_noise(out);
}

}  // namespace

DarkPixels dark_pixels(const DarkPass& dark, View<const float> shading_dn) {
  return {.shading_dn = shading_dn,
          .sum_of_squares = dark.temporal.sum_of_squares(),
          .frames = dark.temporal.frames(),
          .constancy = dark.constancy,
          .step_dn = dark.step_dn,
          .farthest = dark.farthest};
}

DarkPass measure_dark(const GainRun& run, double step_dn) {
  const MosaicGeometry geometry = run.format().geometry(1);  // rows singly: they tell the row group
  DarkPass pass{TemporalAccumulator(geometry, run.format().black_dn, FrameAlignment::kAdditive),
                RowLagAccumulator(geometry),
                {},
                {},
                {},
                {},
                NeighbourCorrelation(geometry),
                {},
                SuccessiveFrames(geometry)};
  pass.step_dn = step_dn;
  EqualValues equal(geometry);
  FramePairs pairs(pass.neighbours, {}, kDarkPairs);
  ZeroShare zeros(geometry, run.zero_dn(), step_dn);
  run.each_frame(run.bias(), [&](const RawFrame& frame, int i) {
    for (int c = 0; i == 0 && c < geometry.channels(); ++c) {
      std::vector<float> pixels = some_pixels(frame.dn, geometry, c);
      const double step = quantization_step(pixels);
      std::optional<double> left_out_dn = left_out_code(pixels, step);
      if (left_out_dn) *left_out_dn -= run.zero_dn()[as_index(c)];
      pass.codes.push_back({run.format().layout.channel_name(c), step,
                            occupied_spacing(std::move(pixels)), left_out_dn});
    }
    pass.temporal.add(frame.dn);
    pass.successive.add(frame.dn);
    equal.add(frame.dn);
    pairs.add(frame.dn);
    pass.rows.add(frame.dn, channel_means(frame.dn, geometry));
    zeros.add(frame.dn);
  });
  pass.constancy = equal.chance_of_constancy();
  pass.floor_dn = pass.floor_code_dn = zeros.floors_dn();
  for (std::size_t c = 0; c < pass.floor_dn.size(); ++c) pass.floor_code_dn[c] -= run.zero_dn()[c];
  pass.zero_share = zeros.shares();
  return pass;
}

void measure_bias(const GainRun& run, DarkPass& dark, PhysicsCalibration& out) {
  const double quantization_dn = dark.step_dn;
  const FrameFormat& format = run.format();
  const MosaicGeometry& geometry = run.geometry();
  const int count = run.bias().count;
  out.bias_frames = count;
  const bool several = count >= 2, remove_pattern = !run.settings().single_frame && several;
  Image pattern = dark.temporal.release_mean_frame_dn();
  add_black(format, pattern);
  std::vector<double> cell =
      remove_pattern ? dark.temporal.variance_dn2() : channel_variances(run.first_dn(), geometry);
  for (double& width : cell)
    width = residual_cell_dn(std::sqrt(std::max(width, 0.0)), quantization_dn);
  FrameAnalyzer analyzer(geometry, format.black_dn, remove_pattern ? &pattern : nullptr, count,
                         cell);
  const OrdinaryPixels ordinary =
      several ? ordinary_pixels(pattern, 0.0, geometry, {}, dark.temporal.sum_of_squares())
              : ordinary_pixels(pattern, quantization_dn, geometry);
  if (remove_pattern)
    expect_offsets(dark, ordinary, count, constant_pixels(dark_pixels(dark, pattern), geometry),
                   analyzer);
  BiasFrames frames;
  const double step = several ? step_of(run.first_dn(), quantization_dn) : 0.0;
  CodePairCounter pairs(geometry, step);
  FarthestValues farthest(dark_pixels(dark, pattern), geometry);
  FloorCheck floors(run, dark);
  const auto drifts_dn = dark.temporal.frame_drifts_dn();
  run.each_frame(run.bias(), [&](const RawFrame& frame, int i) {
    frames.add(analyzer.analyze(frame.dn));
    pairs.add(frame.dn);
    floors.add(frame.dn);
    farthest.add(frame.dn, drifts_dn[as_index(i)]);
  });
  dark.farthest = farthest.release();
  floors.settle();
  const double kept = remove_pattern ? 1.0 - 1.0 / count : 1.0;
  std::vector<double> of_drift(format.black_dn.size(), 0.0);
  if (remove_pattern) of_drift = measure_drift(run, kept, frames, dark, out);
  level_of_ordinary_pixels(channel_means(pattern, geometry), ordinary.mean_dn, frames);
  fill_components(frames, geometry, analyzer.row_covariance_dn2(), kept, out);
  widen_by_drift(of_drift, out);
  if (several) take_hidden_noise(run, pairs, ordinary, dark, out);
  if (remove_pattern)
    undo_cut_off(dsnu_dn(ordinary.variance_dn2, temporal_of(ordinary, count), count), analyzer,
                 format.black_dn, dark, frames, out);
  measure_shapes({frames.residuals, mean_over_frames(frames.pixel), analyzer, dark.hidden,
                  dark.cut_off, quantization_dn, kept, run.settings().shape == "ppcc"},
                 format.layout, out);
  if (remove_pattern) warn_of_few_frames(out);
  warn_of_dark_frames(run, frames, dark, out);
  if (!several) return;
  measure_dsnu(ordinary, temporal_of(ordinary, count), geometry, out);
  subtract_levels(pattern, ordinary.mean_dn, geometry);
  out.dark_shading_dn = std::move(pattern);
  const std::vector<double> of_pattern_dn2 = pattern_error_of_mean(ordinary, geometry, out);
  for (std::size_t c = 0; c < of_pattern_dn2.size(); ++c)
    out.mu.standard_error[c] = std::hypot(out.mu.standard_error[c], std::sqrt(of_pattern_dn2[c]));
  warn_of_light(out.dark_shading_dn, geometry, mean_of(out.temporal_sd_dark_dn), out);
}

}  // namespace malus
