#include "malus/calibrate/internal/dark_corrections.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/internal/censored_noise.h"
#include "malus/calibrate/internal/cut_off_noise.h"
#include "malus/calibrate/internal/fixed_pattern.h"
#include "malus/calibrate/internal/tukey_fit.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr double kLeastSlope = 0.3;  // of what shows

// Noise of whole rows, or columns. It may show next to nothing of itself, but it is a part of the
// noise.
void take_hidden_lines(const HiddenNoise& hidden, std::size_t c, ChannelStatistics& lines) {
  constexpr double kLeastSlopeOfLines = 1e-3;
  double &deviation = lines.mean[c], &error = lines.standard_error[c];
  if (!hidden.known()) {
    error = std::max({error, deviation, std::sqrt(hidden.rounding_dn2)});
    return;
  }
  const double slope = std::max(hidden.slope, kLeastSlopeOfLines);
  const double most_dn = std::sqrt(hidden.variance_dn2);
  for (auto& frame : lines.per_frame) frame[c] /= slope;
  deviation = std::min(deviation / slope, most_dn);
  error = std::min(std::hypot(error, deviation * hidden.slope_stderr) / slope, most_dn);
}

// mu, row and column noise, made of rounded values, where the converter's step hides the noise:
// what the pairs of codes tell, else how far off they may be.
void take_hidden_offsets(HiddenNoise& hidden, double usual_code_dn, std::size_t c,
                         PhysicsCalibration& out) {
  double &mu = out.mu.mean[c], &mu_error = out.mu.standard_error[c];
  for (ChannelStatistics* lines : {&out.sigma_row, &out.sigma_column})
    take_hidden_lines(hidden, c, *lines);
  if (!hidden.known()) {
    mu_error = std::hypot(mu_error, std::sqrt(hidden.rounding_dn2));
    return;
  }
  hidden.shift_dn = mu - (usual_code_dn + hidden.mean_dn);
  for (auto& frame : out.mu.per_frame) frame[c] -= hidden.shift_dn;
  mu -= hidden.shift_dn;
  mu_error = std::max(mu_error / std::max(hidden.slope, kLeastSlope), hidden.mean_stderr_dn);
}

// The pairs of codes take pixels for independent, but whole rows and columns of the fixed pattern
// are fewer. They show of it what the offsets do, and are no more than it.
void widen_by_lines(const OrdinaryPixels& mean_frame, const MosaicGeometry& geometry, int channel,
                    const RowDrift& drift, HiddenNoise& hidden) {
  if (!(hidden.dsnu_dn > 0)) return;
  const double row_dn2 = mean_frame.row_variance_dn2[as_index(channel)],
               column_dn2 = mean_frame.column_variance_dn2[as_index(channel)];
  const double all_dn2 = hidden.dsnu_dn * hidden.dsnu_dn,
               shown = std::pow(std::max(hidden.slope, kLeastSlope), 2);
  const double error_dn4 =
      line_error_dn4(std::min(row_dn2 / shown, all_dn2), std::min(column_dn2 / shown, all_dn2),
                     geometry, channel, drift);
  hidden.dsnu_stderr_dn =
      std::hypot(hidden.dsnu_stderr_dn, root_standard_error(all_dn2, std::sqrt(error_dn4)));
}

// The pairs hold how the frames' level changes, too: as noise where it jumps and as fixed pattern
// where it drifts. All other noise is counted about each frame's level.
void take_level_changes_out(const FrameSeries& frame_means_dn, std::size_t c, HiddenNoise& hidden) {
  constexpr double kLeastLeft = 0.01;  // of the variance
  const auto pairs = static_cast<double>(frame_means_dn.size() - 1);
  double mean = 0, jumps = 0, together = 0;
  for (const std::vector<double>& frame : frame_means_dn)
    mean += frame[c] / static_cast<double>(frame_means_dn.size());
  for (std::size_t f = 1; f < frame_means_dn.size(); ++f) {
    const double before = frame_means_dn[f - 1][c] - mean, after = frame_means_dn[f][c] - mean;
    jumps += 0.5 * (after - before) * (after - before) / pairs;
    together += before * after / pairs;
  }
  const double slope = std::max(hidden.slope, kLeastSlope), shown = slope * slope;
  hidden.variance_stderr_dn2 =
      std::hypot(hidden.variance_stderr_dn2, 2 * jumps / shown * hidden.slope_stderr / slope);
  hidden.variance_dn2 =
      std::max(hidden.variance_dn2 - jumps / shown, kLeastLeft * hidden.variance_dn2);
  const double dsnu_dn2 = hidden.dsnu_dn * hidden.dsnu_dn;
  if (dsnu_dn2 > 0) hidden.dsnu_dn = std::sqrt(std::max(dsnu_dn2 - together / shown, 0.0));
}

// The mirror image is taken of residuals about means that are cut off themselves, by one shift of
// all pixels: beside offsets or steps that are wide against the noise that is not enough.
void warn_of_rough_cut_off(const DarkPass& dark, PhysicsCalibration& out) {
  constexpr double kFewZeros = 0.03, kMostPattern = 0.3, kMostStep = 0.4;
  double pattern = 0, step = 0;  // of the noise
  for (std::size_t c = 0; c < dark.cut_off.size(); ++c) {
    if (!dark.cut_off[c].known || !(dark.zero_share[c] > kFewZeros)) continue;
    pattern = std::max(pattern, out.dsnu_dn[c] / out.temporal_sd_dark_dn[c]);
    step = std::max(step, dark.step_dn / out.temporal_sd_dark_dn[c]);
  }
  if (!(pattern > kMostPattern || step > kMostStep)) return;
  out.warnings.push_back(fmt::format(
      "the fixed pattern is {:.2g} and the converter's step {:.2g} of the dark noise: what it was "
      "before it was cut off is known only roughly, and its standard errors are too small; "
      "raise the black level",
      pattern, step));
}

// Where too much is cut off for a mirror image. shown_dn2: temporal variance; of offsets the share
// that is not cut off shows.
CutOffNoise cut_off_by_law(const CutOffPlace& place, double shown_dn2, double dsnu_dn,
                           double row_dn, double residuals) {
  CutOffNoise cut;
  if (!(place.zero_share > kMostMirroredZeros)) return cut;
  const CensoredNoise law = find_censored_noise(
      {place.level_dn, shown_dn2 + dsnu_dn * dsnu_dn, place.zero_share, place.step_dn, residuals});
  if (!law.known) return cut;
  cut.slope = law.slope;
  cut.shift_dn = place.level_dn - law.mean_dn;
  cut.shift_stderr_dn = law.mean_stderr_dn;
  const double pattern_dn2 = std::pow(dsnu_dn / cut.slope, 2),
               rows_dn2 = std::pow(row_dn / cut.slope, 2);
  cut.variance_dn2 = law.variance_dn2 + place.step_dn * place.step_dn / 12.0 - pattern_dn2 -
                     shown_dn2 - (rows_dn2 - row_dn * row_dn);
  // The law is that of the noise with its offsets, normal ones, which takes of the excess kurtosis
  // twice their share; it is nearly linear in λ.
  const double normal = 2.0 * (pattern_dn2 + rows_dn2) / law.variance_dn2;
  const double more = normal * (law.lambda - kNormalLambda);
  cut.lambda = std::clamp(law.lambda + more, kLambdaLow, kLambdaHigh);
  cut.lambda_stderr = std::hypot(law.lambda_stderr * (1.0 + normal), 0.5 * more);
  cut.variance_stderr_dn2 = law.variance_stderr_dn2;
  cut.by_law = cut.known = cut.variance_dn2 > 0;
  return cut;
}

}  // namespace

void take_hidden_noise(const GainRun& run, CodePairCounter& pairs, const OrdinaryPixels& mean_frame,
                       DarkPass& dark, PhysicsCalibration& out) {
  const std::vector<double> dsnu =
      dsnu_dn(mean_frame.variance_dn2, temporal_of(mean_frame, out.bias_frames), out.bias_frames);
  for (std::size_t c = 0; c < pairs.pairs().size(); ++c) {
    const double zeros = dark.zero_share[c];
    if (zeros > 0) pairs.end_at(dark.floor_dn[c], static_cast<int>(c));
    dark.hidden.push_back(
        hidden_noise(pairs.pairs()[c], std::pow(out.temporal_sd_dark_dn[c], 2), pairs.step_dn()));
    if (!dark.hidden[c].hidden) {
      double &sd = out.temporal_sd_dark_dn[c], &error = out.temporal_sd_dark_stderr_dn[c];
      dark.hidden[c].dsnu_dn = dsnu[c];
      if (sd > 0) error = std::hypot(error, 0.5 * dark.hidden[c].variance_doubt_dn2(sd * sd) / sd);
      continue;
    }
    if (dark.hidden[c].known()) {
      take_level_changes_out(out.mu.per_frame, c, dark.hidden[c]);
      widen_by_lines(mean_frame, run.geometry(), static_cast<int>(c), out.row_drift.drift,
                     dark.hidden[c]);
    }
    const double usual_dn = pairs.usual_code_dn(static_cast<int>(c)) - run.format().black_dn[c];
    take_hidden_offsets(dark.hidden[c], usual_dn, c, out);
    if (!dark.hidden[c].known() || !(zeros > kMostDarkZeros)) continue;
    const double shown_dn = out.temporal_sd_dark_dn[c],
                 before_dn = std::sqrt(dark.hidden[c].codes_dn2);
    out.temporal_sd_dark_stderr_dn[c] *= before_dn / shown_dn;
    out.temporal_sd_dark_dn[c] = before_dn;
  }
}

void undo_cut_off(const std::vector<double>& dsnu_dn, const FrameAnalyzer& analyzer,
                  const std::vector<double>& black_dn, DarkPass& dark, BiasFrames& frames,
                  PhysicsCalibration& out) {
  const std::vector<double> pixel = mean_over_frames(frames.pixel);
  for (std::size_t c = 0; c < dark.zero_share.size(); ++c) {
    dark.cut_off.emplace_back();
    double &mu = out.mu.mean[c], &row = out.sigma_row.mean[c], &sd = out.temporal_sd_dark_dn[c];
    if (dark.hidden[c].hidden) continue;
    const CutOffPlace place{
        mu + black_dn[c] - dark.floor_dn[c], std::hypot(dsnu_dn[c], row), dark.step_dn,
        dark.zero_share[c],
        analyzer.offset_variance_dn2(static_cast<int>(c), std::max(pixel[c], 0.0))};
    const ResidualHistogram all = pooled_over_frames(frames.residuals, c);
    CutOffNoise cut = find_cut_off_noise(all, pooled_over_frames(frames.above, c), place);
    if (!cut.known)
      cut = cut_off_by_law(place, sd * sd, dsnu_dn[c], row, static_cast<double>(all.count()));
    if (!cut.known) continue;
    dark.cut_off.back() = cut;
    for (std::size_t f = 0; f < frames.residuals.size(); ++f) {
      if (!cut.by_law)
        frames.residuals[f][c] =
            residuals_before_cut_off(frames.residuals[f][c], frames.above[f][c], place, cut);
      out.mu.per_frame[f][c] -= cut.shift_dn;
      out.sigma_row.per_frame[f][c] /= cut.slope;
      frames.pixel[f][c] += cut.variance_dn2;
    }
    mu -= cut.shift_dn;
    out.mu.standard_error[c] =
        std::hypot(out.mu.standard_error[c] / cut.slope, cut.shift_stderr_dn);
    const double rows_dn2 = row * row * (1.0 / (cut.slope * cut.slope) - 1.0);
    dark.cut_off.back().rows_dn2 = rows_dn2;
    row /= cut.slope;
    out.sigma_row.standard_error[c] /= cut.slope;
    const double before_dn = std::sqrt(sd * sd + cut.variance_dn2 + rows_dn2);
    out.temporal_sd_dark_stderr_dn[c] =
        std::hypot(sd * out.temporal_sd_dark_stderr_dn[c], 0.5 * cut.variance_stderr_dn2) /
        before_dn;
    sd = before_dn;
  }
  const auto is_undone = [&](std::size_t c) {
    return dark.cut_off[c].known || (dark.zero_share[c] > 0 && dark.hidden[c].known());
  };
  for (std::size_t c = 0; c < dark.cut_off.size(); ++c) out.cut_off_undone |= is_undone(c);
  for (std::size_t c = 0; c < dark.cut_off.size(); ++c)
    out.cut_off_undone &= is_undone(c) || dark.zero_share[c] <= kMostUndoneDarkZeros;
}

void restore_dsnu(const DarkPass& dark, PhysicsCalibration& out) {
  for (std::size_t c = 0; c < dark.hidden.size(); ++c) {
    const HiddenNoise& hidden = dark.hidden[c];
    double &dsnu = out.dsnu_dn[c], &error = out.dsnu_stderr_dn[c];
    if (hidden.known()) {
      dsnu = hidden.dsnu_dn;
      error = hidden.dsnu_stderr_dn;
    } else if (hidden.hidden) {
      error = std::hypot(error, std::sqrt(hidden.rounding_dn2));
    } else if (c < dark.cut_off.size()) {
      dsnu /= dark.cut_off[c].slope;
      error /= dark.cut_off[c].slope;
    }
  }
  warn_of_rough_cut_off(dark, out);
}

}  // namespace malus
