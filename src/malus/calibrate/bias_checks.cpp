#include "malus/calibrate/internal/bias_checks.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/calibrate/internal/channel_words.h"
#include "malus/calibrate/internal/row_drift_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr std::size_t kFewestFrames = 8;  // to judge their levels by

// Mean over the channels of every frame.
std::vector<double> levels_of(const FrameSeries& frame_means_dn) {
  std::vector<double> level;
  for (const auto& frame : frame_means_dn) level.push_back(mean_of(frame));
  return level;
}

// Mean size of a frame's residuals, which heavy tails disturb less than the mean square, and its
// standard error.
struct FrameNoise {
  double size_dn = 0, error_dn = 0;
};

FrameNoise noise_of(const std::vector<ResidualHistogram>& channels,
                    const std::vector<HiddenNoise>& hidden) {
  double count = 0, sum = 0, squares = 0;
  for (std::size_t c = 0; c < channels.size(); ++c) {
    if (c < hidden.size() && hidden[c].hidden) continue;
    for (const ResidualHistogram::Cell& cell : channels[c].cells()) {
      const double size = std::abs(channels[c].centre_dn(cell));
      count += cell.count;
      sum += cell.count * size;
      squares += cell.count * size * size;
    }
  }
  if (!(count > 0)) return {};
  const double mean = sum / count;
  return {mean, std::sqrt(std::max(squares / count - mean * mean, 0.0) / count)};
}

// Standard error that the offsets of a frame's columns, of which there are few, give the size of
// its residuals: half of their variance's over that of both.
double relative_error_of_columns(int columns, const PhysicsCalibration& out) {
  double column = 0, all = 0;
  for (std::size_t c = 0; c < out.sigma_column.mean.size(); ++c) {
    column += std::pow(out.sigma_column.mean[c], 2);
    all += std::pow(out.temporal_sd_dark_dn[c], 2) - std::pow(out.sigma_row.mean[c], 2);
  }
  return all > 0 ? 0.5 * std::min(column / all, 1.0) * std::sqrt(2.0 / std::max(columns, 1)) : 0.0;
}

// The mean, to which no pixel adds more than `most` beyond the middle one: hot ones are no light.
double level_of(const std::vector<double>& values, double most) {
  const double middle = median_of(values);
  double sum = 0;
  for (const double v : values) sum += std::clamp(v - middle, -most, most);
  return middle + sum / static_cast<double>(values.size());
}

// Variance that rows give the mean over one of so many blocks of rows.
double rows_in_block_dn2(int blocks, const MosaicGeometry& geometry,
                         const PhysicsCalibration& out) {
  if (out.sigma_row.mean.empty()) return 0.0;
  const int groups = std::max(geometry.channel_groups(0) / blocks, 1);
  const double sigma_dn = mean_of(out.sigma_row.mean);
  return sigma_dn * sigma_dn / groups *
         (1.0 + drift_of_means(out.row_drift.drift, groups, geometry.group_stride(0), 0));
}

// Half the mean square difference of values `apart` places apart: of independent ones their
// variance, in which what is smooth has next to no part.
double variance_of_next(const std::vector<double>& values, int apart) {
  double sum = 0;
  const auto pairs = std::ssize(values) - apart;
  for (std::ptrdiff_t i = 0; i < pairs; ++i)
    sum += std::pow(values[as_index(i + apart)] - values[as_index(i)], 2);
  return pairs > 0 ? 0.5 * sum / static_cast<double>(pairs) : 0.0;
}

// Variance that the fixed pattern of pixels, rows and columns gives the mean over one of `blocks`
// times `blocks` blocks, told by neighbours of one channel. Values count up to `most` about 0, as
// in level_of.
double pattern_in_block_dn2(View<const float> shading_dn, const MosaicGeometry& geometry,
                            int blocks, double most) {
  const int rows = geometry.rows(), cols = geometry.cols();
  const int down = geometry.cell_rows(), across = geometry.cell_cols();
  const auto at = [&](int r, int c) { return std::clamp(double{shading_dn(r, c)}, -most, most); };
  std::vector<double> of_row(as_index(rows), 0.0), of_col(as_index(cols), 0.0);
  Moments squares;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      of_row[as_index(r)] += at(r, c) / cols;
      of_col[as_index(c)] += at(r, c) / rows;
      if (r + down >= rows || c + across >= cols) continue;
      const double both = at(r, c) - at(r + down, c) - at(r, c + across) + at(r + down, c + across);
      squares.add(0.25 * both * both);
    }
  const double pixel = squares.count() > 0 ? squares.mean() : 0.0;
  const double row = std::max(variance_of_next(of_row, down) - pixel / cols, 0.0);
  const double col = std::max(variance_of_next(of_col, across) - pixel / rows, 0.0);
  return blocks * (row / rows + col / cols + blocks * pixel / (double{1} * rows * cols));
}

}  // namespace

void warn_of_drift(const FrameSeries& frame_means_dn, double temporal_sd_dn,
                   PhysicsCalibration& out) {
  if (frame_means_dn.size() < kFewestFrames) return;
  const std::vector<double> level = levels_of(frame_means_dn);
  std::vector<double> index(level.size());
  std::iota(index.begin(), index.end(), 0.0);
  const LineFit line = fit_line(index, level);
  const double drift = line.slope * index.back(), error = line.slope_standard_error * index.back();
  if (std::abs(drift) > 5.0 * error && std::abs(drift) > 0.05 * temporal_sd_dn)
    out.warnings.push_back(
        fmt::format("the dark level drifts by {:.3g} ± {:.2g} DN over the {} bias frames: let the "
                    "camera warm up first",
                    drift, error, frame_means_dn.size()));
}

void warn_of_outlying_frames(const FrameSeries& frame_means_dn, double temporal_sd_dn,
                             PhysicsCalibration& out) {
  constexpr double kDeviations = 8.0, kOfNoise = 0.2;
  if (frame_means_dn.size() < kFewestFrames) return;
  const std::vector<double> level = levels_of(frame_means_dn);
  const double middle = median_of(level);
  const double most = std::max(kDeviations * robust_deviation_of(level), kOfNoise * temporal_sd_dn);
  std::vector<std::string> outlying;
  double farthest = 0;
  for (std::size_t i = 0; i < level.size(); ++i) {
    if (!(std::abs(level[i] - middle) > most)) continue;
    outlying.push_back(fmt::format("{}", i + 1));
    if (std::abs(level[i] - middle) > std::abs(farthest)) farthest = level[i] - middle;
  }
  if (!outlying.empty())
    out.warnings.push_back(
        fmt::format("bias frame {} of {}: the level lies up to {:+.3g} DN from that of the others: "
                    "light, or another setting? leave them out",
                    joined(outlying), level.size(), farthest));
}

void warn_of_outlying_noise(const std::vector<std::vector<ResidualHistogram>>& residuals,
                            const std::vector<HiddenNoise>& hidden, int columns,
                            PhysicsCalibration& out) {
  constexpr double kOfNoise = 0.15, kStandardErrors = 8.0;
  if (residuals.size() < 3) return;  // two are mirror images, about their mean
  std::vector<FrameNoise> noise;
  for (const auto& frame : residuals) noise.push_back(noise_of(frame, hidden));
  // A frame of the set, not between two: half of them may be of another setting.
  const auto lower = [](const FrameNoise& a, const FrameNoise& b) { return a.size_dn < b.size_dn; };
  std::vector<FrameNoise> sorted = noise;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>((sorted.size() - 1) / 2);
  std::nth_element(sorted.begin(), middle, sorted.end(), lower);
  if (!(middle->size_dn > 0)) return;
  const double of_columns = relative_error_of_columns(columns, out);
  std::vector<std::string> outlying;
  double farthest = 1.0;
  for (std::size_t i = 0; i < noise.size(); ++i) {
    const double ratio = noise[i].size_dn / middle->size_dn;
    const double error =
        std::hypot(std::max(noise[i].error_dn, middle->error_dn) / middle->size_dn, of_columns);
    if (!(std::abs(ratio - 1.0) > std::max(kOfNoise, kStandardErrors * error))) continue;
    outlying.push_back(fmt::format("{}", i + 1));
    if (std::abs(ratio - 1.0) > std::abs(farthest - 1.0)) farthest = ratio;
  }
  if (!outlying.empty())
    out.warnings.push_back(fmt::format(
        "bias frame {} of {}: the pixels' noise is up to {:.2g} times that of the middle frame: "
        "another gain, exposure or temperature? leave them out",
        joined(outlying), noise.size(), farthest));
}

void warn_of_high_level(const FrameFormat& format, PhysicsCalibration& out) {
  constexpr double kOfRange = 0.1, kOfBlack = 0.1, kLeastBelow = 1, kOfNoise = 20, kLeast = 2;
  const double black = mean_of(format.black_dn), range = format.mean_range_dn();
  const double level = mean_of(out.mu.mean);
  const double noise = mean_of(out.temporal_sd_dark_dn);
  if (level > kOfRange * range)
    out.warnings.push_back(
        fmt::format("the dark level lies {:.4g} DN above black, {:.0f} % of the range: are these "
                    "dark frames, and is the black level right?",
                    level, 100 * level / range));
  else if (format.black_known && noise > 0 && level > kOfNoise * noise && level > kLeast)
    out.warnings.push_back(fmt::format(
        "the dark level lies {:.4g} DN above the black level of {:.4g} DN, {:.3g} times the dark "
        "noise: is black that of another bit depth? Give black = {:.4g} in [sensor] if not",
        level, black, level / noise, level + black));
  if (-level > std::max(kLeastBelow, kOfBlack * black))
    out.warnings.push_back(fmt::format(
        "the dark level lies {:.4g} DN below the black level of {:.4g} DN: is that right?", -level,
        black));
}

void warn_of_lit_darkness(const FrameFormat& format, PhysicsCalibration& out) {
  constexpr double kOfNoise = 4, kFewest = 0.6, kMost = 1.15;
  if (!format.black_known || out.K.mean.empty()) return;
  const double level = mean_of(out.mu.mean), noise = mean_of(out.temporal_sd_dark_dn);
  const double share = mean_of(out.K.mean) * level / (noise * noise);
  if (!(level > kOfNoise * noise) || share < kFewest || share > kMost) return;
  out.warnings.push_back(fmt::format(
      "the dark level lies {:.4g} DN above black, and the shot noise of as much light is {:.0f} % "
      "of the dark variance: were the dark frames dark? Read noise and dark noise hold it (long "
      "exposures: dark current)",
      level, 100 * share));
}

void warn_of_light(View<const float> shading_dn, const MosaicGeometry& geometry,
                   double temporal_sd_dn, PhysicsCalibration& out) {
  constexpr int kBlocks = 4;
  constexpr double kOutlying = 3;
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (int i = 0; i < kBlocks; ++i)
    for (int j = 0; j < kBlocks; ++j) {
      std::vector<double> block;
      for (int r = i * geometry.rows() / kBlocks; r < (i + 1) * geometry.rows() / kBlocks; ++r)
        for (int c = j * geometry.cols() / kBlocks; c < (j + 1) * geometry.cols() / kBlocks; ++c)
          block.push_back(shading_dn(r, c));
      if (block.empty()) continue;
      const double level = level_of(block, kOutlying * temporal_sd_dn);
      low = std::min(low, level);
      high = std::max(high, level);
    }
  // Four standard errors of a difference of block means, so that few frames, and the DSNU of few or
  // unlike pixels and columns, do not cry wolf.
  const double pixels =
      static_cast<double>(geometry.rows()) * geometry.cols() / (kBlocks * kBlocks);
  const double of_one_dn2 =
      temporal_sd_dn * temporal_sd_dn / pixels + rows_in_block_dn2(kBlocks, geometry, out);
  const double of_pattern_dn2 =
      pattern_in_block_dn2(shading_dn, geometry, kBlocks, kOutlying * temporal_sd_dn);
  const double chance =
      4.0 * std::sqrt(2.0 * (of_one_dn2 / std::max(out.bias_frames, 1) + of_pattern_dn2));
  if (!(high - low > std::max(0.5 * temporal_sd_dn, chance))) return;
  const std::string of_noise = temporal_sd_dn > 0 ? fmt::format(", {:.2g} times the temporal noise",
                                                                (high - low) / temporal_sd_dn)
                                                  : "";
  out.warnings.push_back(
      fmt::format("the dark level differs by {:.3g} DN over the frame{}: light leak, amplifier "
                  "glow, or outputs with levels of their own",
                  high - low, of_noise));
}

void warn_of_clipping(const std::vector<double>& zero_share, const std::vector<double>& lowest_dn,
                      const SensorLayout& layout, PhysicsCalibration& out) {
  std::vector<std::string> cut;
  double most = 0.0, floor = 0.0;
  for (int c = 0; c < layout.channels(); ++c) {
    const double share = zero_share[static_cast<std::size_t>(c)];
    if (share > kMostSilentZeros) cut.push_back(layout.channel_name(c));
    if (share > most) floor = lowest_dn[static_cast<std::size_t>(c)];
    most = std::max(most, share);
  }
  if (cut.empty()) return;
  out.dark_zero_share = zero_share;
  out.warnings.push_back(fmt::format(
      "{}: up to {:.3g} % of the dark pixels are {}, above {:g} %: the camera's black "
      "level cuts the noise off; raise it{}",
      channels_text(cut, layout), 100 * most,
      floor == 0 ? "0" : fmt::format("at {:g} DN, the lowest code", floor), 100 * kMostSilentZeros,
      out.cut_off_undone
          ? " (physics and Gaussian models hold what the noise was before, worked out as "
            "symmetric)"
          : ""));
}

void warn_of_column_noise(PhysicsCalibration& out) {
  constexpr double kOfTemporal = 0.1, kErrors = 5.0;
  double column = 0, temporal = 0;
  bool sure = false;
  for (std::size_t c = 0; c < out.sigma_column.mean.size(); ++c) {
    column += out.sigma_column.mean[c];
    temporal += out.temporal_sd_dark_dn[c];
    sure = sure || out.sigma_column.mean[c] > kErrors * out.sigma_column.standard_error[c];
  }
  if (!sure || !(column > kOfTemporal * temporal)) return;
  const auto channels = static_cast<double>(out.sigma_column.mean.size());
  out.warnings.push_back(
      fmt::format("its columns change from frame to frame by {:.3g} DN, {:.0f} % of the temporal "
                  "noise: denoise takes their offsets out, but synthesize draws them as noise of "
                  "single pixels",
                  column / channels, 100 * column / temporal));
}

}  // namespace malus
