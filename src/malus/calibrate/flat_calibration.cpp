#include "malus/calibrate/internal/flat_calibration.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/calibrate/internal/bias_checks.h"
#include "malus/calibrate/internal/channel_words.h"
#include "malus/calibrate/internal/dark_point.h"
#include "malus/calibrate/internal/flat_checks.h"
#include "malus/calibrate/internal/flat_level.h"
#include "malus/calibrate/internal/flat_patterns.h"
#include "malus/calibrate/internal/gain_map.h"
#include "malus/calibrate/internal/matching_dark.h"
#include "malus/calibrate/internal/neighbour_correlation.h"
#include "malus/calibrate/internal/photon_transfer.h"
#include "malus/calibrate/internal/response.h"
#include "malus/calibrate/internal/response_checks.h"
#include "malus/calibrate/internal/saturation.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr double kMostSaturated = 1e-3;
constexpr std::size_t kFewLevels = 5;

RefusedLevel reason_against(const TransferLevel& level, double saturated, double range_dn,
                            double limit) {
  if (level.frames < 2)
    return {Refusal::kOneFrame, "one frame has no temporal variance; 2 are needed"};
  const double share = level.mean_dn / range_dn;
  if (share > limit)
    return {Refusal::kAboveLimit,
            fmt::format("mean is {:.1f} % of the range, above the limit of {:.0f} %", 100 * share,
                        100 * limit)};
  if (saturated > kMostSaturated)
    return {Refusal::kWhite, fmt::format("{:.3g} % of the pixels are saturated, above {:.1f} %",
                                         100 * saturated, 100 * kMostSaturated)};
  if (!(level.mean_dn > 0)) return {Refusal::kNotAboveDark, "the mean is not above the dark level"};
  return {};
}

void append_transfer(int channel, const Estimate<TransferFit>& fit,
                     const std::vector<TransferLevel>& levels, const std::vector<double>& exposures,
                     PhysicsCalibration& out) {
  for (std::size_t i = 0; i < levels.size(); ++i) {
    PhotonTransferPoint point;
    point.channel = channel;
    point.exposure_s = exposures[i];
    point.mean_dn = levels[i].mean_dn;
    if (levels[i].frames >= 2)
      point.variance_dn2 = levels[i].variance_dn2 - levels[i].dark_variance_dn2;
    point.variance_stderr_dn2 =
        fit ? fit->variance_stderr_dn2[i] : std::numeric_limits<double>::quiet_NaN();
    point.used = levels[i].refused.empty();
    point.why_not = levels[i].refused.words;
    point.saturated = levels[i].saturated;
    point.at_white = levels[i].at_white;
    point.dark_variance_dn2 = levels[i].dark_variance_dn2;
    out.transfer.push_back(std::move(point));
  }
}

// The reason against the most levels, of a channel with too few.
std::string most_frequent_reason(const std::vector<TransferLevel>& levels) {
  std::map<Refusal, std::vector<const std::string*>> reasons;
  std::size_t used = 0;
  for (const TransferLevel& level : levels)
    if (level.refused.empty())
      ++used;
    else
      reasons[level.refused.reason].push_back(&level.refused.words);
  const auto most = std::max_element(
      reasons.begin(), reasons.end(),
      [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); });
  if (used >= 2 || most == reasons.end()) return {};
  return fmt::format("; {} of {}: {}", most->second.size(), levels.size(), *most->second.front());
}

// Fits of all channels into K; one warning for all channels that have the same trouble.
void append_fits(const std::vector<Estimate<TransferFit>>& fits,
                 const std::vector<std::vector<TransferLevel>>& levels, const SensorLayout& layout,
                 PhysicsCalibration& out) {
  std::vector<std::string> scattered, bent;
  double most_chi_square = 0.0, most_excess_dn2 = 0.0, most_percent = 0.0;
  for (int c = 0; c < layout.channels(); ++c) {
    const auto& fit = fits[as_index(c)];
    if (!fit) {
      out.warnings.push_back(
          fmt::format("{}: the gain K is not known{}: {}{}", layout.channel_name(c),
                      layout.channels() > 1 ? ", so K of no channel is kept" : "", fit.reason(),
                      most_frequent_reason(levels[as_index(c)])));
      out.K = {};
      out.K_intercept_dn2.clear();
      out.K_intercept_stderr_dn2.clear();
      return;
    }
    out.K.mean.push_back(fit->slope_dn_per_e);
    out.K.standard_error.push_back(fit->slope_stderr);
    out.K_intercept_dn2.push_back(fit->intercept_dn2);
    out.K_intercept_stderr_dn2.push_back(fit->intercept_stderr_dn2);
    if (fit->bend_dn_per_e != 0.0) {
      bent.push_back(layout.channel_name(c));
      const double percent = 100 * fit->bend_dn_per_e / fit->slope_dn_per_e;
      if (std::abs(percent) > std::abs(most_percent)) most_percent = percent;
      continue;
    }
    if (!(fit->excess_deviation_dn2 > 0)) continue;
    scattered.push_back(layout.channel_name(c));
    most_chi_square = std::max(most_chi_square, fit->chi_square_per_level);
    most_excess_dn2 = std::max(most_excess_dn2, fit->excess_deviation_dn2);
  }
  std::size_t used = 0;
  for (const PhotonTransferPoint& point : out.transfer) used += point.channel == 0 && point.used;
  if (used < kFewLevels)
    out.warnings.push_back(
        fmt::format("K rests on {} light levels; {} or more show whether the sensor is linear",
                    used, kFewLevels));
  if (!bent.empty())
    out.warnings.push_back(fmt::format(
        "{}: the sensor is not linear (or its light or dark frames do not match the session file): "
        "K "
        "of all levels differs by up to {:+.1f} % from "
        "that without light, which its standard error now holds; K is nearer to it with a lower "
        "saturation limit",
        channels_text(bent, layout), most_percent));
  if (!scattered.empty())
    out.warnings.push_back(fmt::format(
        "{}: the photon-transfer curve is not a straight line within its sampling errors (χ² per "
        "level up to {:.1f}); K's standard error is widened by a scatter of up to {:.3g} DN² per "
        "level",
        channels_text(scattered, layout), most_chi_square, most_excess_dn2));
}

double mean_square(const std::vector<double>& values) {
  return std::inner_product(values.begin(), values.end(), values.begin(), 0.0) /
         static_cast<double>(values.size());
}

// The flat levels of one gain as they are measured one after the other.
struct FlatSeries {
  std::vector<std::vector<TransferLevel>> levels;  ///< [channel][level]
  FlatPatterns patterns;
  std::vector<double> exposures_s = {};
  std::vector<std::vector<bool>> good = {};  ///< [level][channel]: not refused
  std::vector<FlatObservation> seen = {};
  std::vector<GainBlocks> gains = {};              ///< per level
  std::vector<std::vector<double>> light_dn = {};  ///< of the levels that count, per channel
};

void add_level(const FrameSet& flat, FlatLevel level, const MatchingDark& dark,
               const RawFrame& first, const std::vector<double>& frame_deviation_dn,
               int bias_frames, double saturation_limit, FlatSeries& series) {
  const std::vector<double> mean = level.temporal.mean_dn(level.filled, dark.shading_dn()),
                            dark_variance = dark.variance_without_dn2(level.filled);
  const std::vector<double> variance = flat.count >= 2 ? level.temporal.variance_dn2(level.filled)
                                                       : std::vector<double>(mean.size(), 0.0);
  std::vector<bool> good;
  for (std::size_t c = 0; c < mean.size(); ++c) {
    const double range = first.white_dn - first.black_dn[c];
    TransferLevel point;
    point.mean_dn = mean[c];
    const double frame_variance = frame_deviation_dn[c] * frame_deviation_dn[c];
    point.mean_variance_dn2 = frame_variance / flat.count;
    point.dark_mean_variance_dn2 = frame_variance / (dark.frames ? dark.frames : bias_frames);
    point.dark_variance_dn2 = dark_variance[c];
    point.variance_dn2 =
        steady_variance_dn2(level.temporal, c, mean[c], variance[c], point.dark_variance_dn2);
    point.frames = flat.count;
    point.exposure_s = flat.exposure_s.value_or(0.0);
    point.dark_frames = dark.frames;
    point.dark_set = dark.set;
    point.dark_zero_share = dark.zero_share[c];
    point.dark_current_dn = dark.current_dn[c];
    point.zero_share = level.at_zero[c];
    point.at_white = level.saturated[c] > kMostSaturated;
    point.refused = reason_against(point, level.saturated[c], range, saturation_limit);
    good.push_back(point.refused.empty());
    series.levels[c].push_back(std::move(point));
  }
  series.exposures_s.push_back(flat.exposure_s.value_or(0.0));
  const bool all_good = std::find(good.begin(), good.end(), false) == good.end();
  if (!all_good) level.seen.successive = {};
  series.seen.push_back(std::move(level.seen));
  series.gains.push_back(all_good ? std::move(level.gains) : GainBlocks());
  if (all_good) series.light_dn.push_back(mean);
  add_patterns(flat, level, dark, first, good, series.patterns);
  series.good.push_back(std::move(good));
}

void leave_out_saturated(const DarkPoint& dark, std::vector<TransferLevel>& levels) {
  const std::vector<bool> saturated = saturated_levels(levels, dark);
  for (std::size_t i = 0; i < levels.size(); ++i) {
    levels[i].saturated = saturated[i];
    if (saturated[i] && levels[i].refused.empty())
      levels[i].refused = {
          Refusal::kPastMaximum,
          fmt::format("saturated at {:.4g} DN: the variance falls while the mean rises",
                      levels[i].mean_dn)};
  }
}

bool saturated_in_any(const FlatSeries& series, std::size_t level) {
  return std::any_of(
      series.levels.begin(), series.levels.end(),
      [&](const std::vector<TransferLevel>& channel) { return channel[level].saturated; });
}

// Which levels are saturated is known when all are measured. Keeping each one's mean frame until
// then would take memory without bound, and taking a sum back loses digits (a saturated level has
// next to no noise, hence most of the weight): the good ones are read again.
void take_saturated_out_of_patterns(const std::vector<const FrameSet*>& flats,
                                    const std::vector<const FrameSet*>& darks,
                                    const RawFrame& first, const DarkPass& dark,
                                    const MosaicGeometry& geometry, Progress& progress,
                                    const PhysicsCalibration& bias, FlatSeries& series) {
  std::vector<std::size_t> kept;
  std::int64_t frames = 0;
  bool changed = false;
  for (std::size_t i = 0; i < flats.size(); ++i) {
    std::vector<bool>& good = series.good[i];
    for (std::size_t c = 0; c < good.size(); ++c) {
      changed |= good[c] && series.levels[c][i].saturated;
      good[c] = good[c] && !series.levels[c][i].saturated;
    }
    if (std::find(good.begin(), good.end(), true) == good.end()) continue;
    kept.push_back(i);
    frames += flats[i]->count;
  }
  if (!changed) return;
  series.patterns = FlatPatterns(geometry);
  progress.begin("calibrating, saturated flats left out", frames);
  for (const std::size_t i : kept) {
    const MatchingDark own = matching_dark(*flats[i], darks, first, dark, bias, progress);
    FlatLevel level = measure_level(*flats[i], first, own, progress);
    add_patterns(*flats[i], level, own, first, series.good[i], series.patterns);
  }
}

void warn_of_full_well(const FlatSeries& series, double limit, double range_dn,
                       PhysicsCalibration& out) {
  std::vector<std::string> names;
  double lowest = range_dn;
  for (std::size_t i = 0; i < series.seen.size(); ++i) {
    if (!saturated_in_any(series, i)) continue;
    names.push_back(series.seen[i].name);
    for (const std::vector<TransferLevel>& channel : series.levels)
      if (channel[i].saturated) lowest = std::min(lowest, channel[i].mean_dn);
  }
  if (names.empty()) return;
  // Shot noise meets the end a little below it.
  const double advised = std::min(limit, 0.9 * lowest / range_dn);
  out.warnings.push_back(fmt::format(
      "the sensor saturates (or its response has a knee) at {:.4g} DN above black, below white: "
      "there the variance falls while the mean rises. Left out of K and PRNU: {}. Full well and "
      "dynamic range count to there; use shorter exposures, or a saturation limit of {:.2f}",
      lowest, joined(names), advised));
}

// A bent response x = s (1 - b s) shows a difference between pixels as dx/ds s/x, to first order
// 1 - b x, of what it is in little light. PRNU is that of its levels, as EMVA 1288 has it; how far
// it is from the pixels' own goes into the error, as for K.
void widen_by_bend(const std::vector<Estimate<TransferFit>>& fits, Response& relative) {
  for (std::size_t c = 0; c < fits.size(); ++c)
    if (fits[c])
      relative.prnu_stderr[c] =
          std::hypot(relative.prnu_stderr[c],
                     relative.prnu[c] * fits[c]->response_bend_per_dn * relative.level_dn[c]);
}

// What the levels say against themselves, the session and the sensor.
void judge_flats(FlatSeries& series, const RawFrame& first, const DarkPass& dark, int row_group,
                 double saturation_limit, bool cut_off, PhysicsCalibration& out) {
  warn_of_full_well(series, saturation_limit, first.white_dn - mean_of(first.black_dn), out);
  for (std::size_t i = 0; i < series.gains.size(); ++i)
    if (saturated_in_any(series, i)) {
      series.gains[i] = {};
      series.seen[i].successive = {};
    }
  const bool other_light =
      warn_of_flats(series.seen,
                    {.dark_sd_dn = mean_of(out.temporal_sd_dark_dn),
                     .frame_sd_dn = mean_of(dark.temporal.frame_deviation_dn()),
                     .bias_frames = out.bias_frames,
                     .row_variance_dn2 = mean_square(out.sigma_row.mean),
                     .column_variance_dn2 = mean_square(out.sigma_column.mean),
                     .row_groups = static_cast<double>(first.dn.rows()) / row_group,
                     .step_dn = dark.step_dn,
                     .codes = dark.codes,
                     .black_dn = mean_of(first.black_dn),
                     .white_dn = first.white_dn},
                    out);
  if (cut_off && !out.K.mean.empty())
    out.warnings.push_back(
        "K rests on the flat frames alone: dark noise that is cut off makes no dark point");
  if (!other_light)  // which explains another variance
    warn_of_gain_map(
        series.gains,
        {mean_square(out.sigma_row.mean), static_cast<double>(first.dn.rows()) / row_group}, out);
  warn_of_image_lag(series.seen, dark.successive, out);
  warn_of_colors(first.layout, series.light_dn, out);
  warn_of_angles(first.layout, series.light_dn, out);
  warn_of_lit_darkness(first, out);
  warn_of_alike_neighbours(dark.neighbours, series.patterns.neighbours, out);
}

}  // namespace

void measure_flats(const std::vector<const FrameSet*>& flats,
                   const std::vector<const FrameSet*>& darks, const FrameSet& bias,
                   const RawFrame& first, const DarkPass& dark, int row_group,
                   const CalibrationSettings& settings, Progress& progress,
                   PhysicsCalibration& out) {
  const MosaicGeometry geometry(first.layout, first.dn.rows(), first.dn.cols(), row_group);
  MALUS_REQUIRE(out.sigma_row.mean.size() == as_index(geometry.channels()) &&
                !out.dark_shading_dn.empty());
  const std::vector<double> frame_deviation = dark.temporal.frame_deviation_dn();
  const std::vector<double> dark_variance = dark.temporal.variance_dn2();
  FlatSeries series{std::vector<std::vector<TransferLevel>>(as_index(geometry.channels())),
                    FlatPatterns(geometry)};
  for (const FrameSet* flat : flats) {
    const MatchingDark own = matching_dark(*flat, darks, first, dark, out, progress);
    add_level(*flat, measure_level(*flat, first, own, progress), own, first, frame_deviation,
              out.bias_frames, settings.saturation_limit, series);
  }
  out.flat_levels = static_cast<int>(flats.size());
  std::vector<Estimate<TransferFit>> fits;
  bool cut_off = false;
  const bool any_hidden =
      std::any_of(dark.hidden.begin(), dark.hidden.end(), std::mem_fn(&HiddenNoise::hidden));
  for (int c = 0; c < geometry.channels(); ++c) {
    std::vector<TransferLevel>& levels = series.levels[as_index(c)];
    DarkPoint point = dark_point(c, geometry, dark_variance[as_index(c)], out);
    point.cut_off = dark.zero_share[as_index(c)] > kMostDarkZeros;
    if (!dark.hidden.empty()) take_hidden_noise(dark.hidden[as_index(c)], point, levels);
    if (!dark.cut_off.empty())
      take_cut_off(dark.cut_off[as_index(c)], dark.zero_share[as_index(c)],
                   dark.floor_dn[as_index(c)], point, levels);
    if (any_hidden) append_dark_point(dark.hidden[as_index(c)].hidden, point, out);
    cut_off |= point.cut_off;
    leave_out_saturated(point, levels);
    fits.push_back(fit_photon_transfer(levels, point));
    append_transfer(c, fits.back(), levels, series.exposures_s, out);
  }
  append_fits(fits, series.levels, first.layout, out);
  take_saturated_out_of_patterns(flats, darks, first, dark, geometry, progress, out, series);
  const bool all_bright = series.patterns.response.channels_without().empty();
  if (all_bright) warn_of_unlit_lines(series.patterns.response.unlit_lines(), out);
  judge_flats(series, first, dark, row_group, settings.saturation_limit, cut_off, out);
  if (all_bright) {
    Response relative = series.patterns.response.response();
    widen_by_bend(fits, relative);
    warn_of_response(response_pattern(relative, geometry), first.layout, out);
    out.prnu_map = std::move(relative.map);
    out.prnu = std::move(relative.prnu);
    out.prnu_stderr = std::move(relative.prnu_stderr);
    warn_of_dark_current(series.patterns.darkless, bias.exposure_s.value_or(0.0), out);
  } else if (!out.K.mean.empty()) {
    out.warnings.push_back(response_missing(series.patterns, first));
  }
}

}  // namespace malus
