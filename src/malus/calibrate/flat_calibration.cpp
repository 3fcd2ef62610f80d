#include "malus/calibrate/internal/flat_calibration.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/calibrate/internal/bias_checks.h"
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
#include "malus/calibrate/internal/transfer_results.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr double kMostSaturated = 1e-3;

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

double mean_square(const std::vector<double>& values) {
  return std::inner_product(values.begin(), values.end(), values.begin(), 0.0) /
         static_cast<double>(values.size());
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

// The flat levels of one gain: measured one after the other, then fitted and judged together. To be
// used in the order of its functions. `out` holds what the bias frames told.
class FlatSeries {
 public:
  FlatSeries(const GainRun& run, const CommonDark& common, FrameRowNoise rows)
      : run_(run),
        common_(common),
        rows_(std::move(rows)),
        frame_deviation_dn_(common.pass.temporal.frame_deviation_dn()),
        levels_(as_index(run.geometry().channels())),
        patterns_(run.geometry()) {}

  void add(const FrameSet& flat);
  void fit(PhysicsCalibration& out);
  void take_saturated_out_of_patterns();
  void judge(PhysicsCalibration& out);
  void tell_response(PhysicsCalibration& out) const;

 private:
  bool light_is_known() const;
  DarkPoint corrected_dark_point(int channel, PhysicsCalibration& out);
  bool saturated_in_any(std::size_t level) const;
  bool all_bright() const { return patterns_.response.channels_without().empty(); }
  void warn_of_full_well(PhysicsCalibration& out) const;
  std::string reason_against_response() const;
  FlatReference reference(const PhysicsCalibration& bias) const;

  const GainRun& run_;
  CommonDark common_;
  FrameRowNoise rows_;
  std::vector<double> frame_deviation_dn_;          ///< of the bias frames, per channel
  std::vector<std::vector<TransferLevel>> levels_;  ///< [channel][level]
  FlatPatterns patterns_;
  std::vector<std::vector<bool>> good_;        ///< [level][channel]: not refused
  std::vector<FlatObservation> seen_;          ///< per level
  std::vector<GainBlocks> gains_;              ///< per level
  std::vector<std::vector<double>> light_dn_;  ///< of the levels that count, per channel
  std::vector<Estimate<TransferFit>> fits_;    ///< per channel
  std::vector<bool> cut_off_;                  ///< per channel, its dark point
};

// Reads the flats, and their own dark frames where they have them.
void FlatSeries::add(const FrameSet& flat) {
  const MatchingDark dark = matching_dark(run_, flat, common_);
  FlatLevel level = measure_level(run_, flat, dark, rows_);
  const int frames = level.temporal.frames();
  const std::vector<double> mean = level.temporal.mean_dn(level.left_out, dark.shading_dn()),
                            dark_variance = dark.variance_without_dn2(level.left_out),
                            variance = frames >= 2 ? level.variance_dn2
                                                   : std::vector<double>(mean.size(), 0.0);
  std::vector<bool> good;
  for (std::size_t c = 0; c < mean.size(); ++c) {
    TransferLevel point;
    point.mean_dn = mean[c];
    const double frame_variance = frame_deviation_dn_[c] * frame_deviation_dn_[c];
    point.mean_variance_dn2 = frame_variance / frames;
    point.dark_mean_variance_dn2 = frame_variance / (dark.frames ? dark.frames : run_.bias().count);
    point.dark_variance_dn2 = dark_variance[c];
    point.variance_dn2 =
        steady_variance_dn2(level.temporal, c, mean[c], variance[c], point.dark_variance_dn2);
    point.frames = frames;
    point.exposure_s = flat.exposure_s.value_or(0.0);
    point.dark_frames = dark.frames;
    point.dark_set = dark.set;
    point.dark_zero_share = dark.zero_share[c];
    point.dark_current_dn = dark.current_dn[c];
    point.zero_share = level.at_zero[c];
    point.at_white = level.saturated[c] > kMostSaturated;
    point.refused = reason_against(point, level.saturated[c], run_.format().range_dn(c),
                                   run_.settings().saturation_limit);
    good.push_back(point.refused.empty());
    levels_[c].push_back(std::move(point));
  }
  const bool all_good = std::find(good.begin(), good.end(), false) == good.end();
  if (!all_good) level.seen.successive = {};
  seen_.push_back(std::move(level.seen));
  gains_.push_back(all_good ? std::move(level.gains) : GainBlocks());
  if (all_good && light_is_known()) light_dn_.push_back(mean);
  patterns_.add(run_.format(), flat, level, dark, good);
  good_.push_back(std::move(good));
}

// That of the last level, to a hundredth: what colours and angles see of less is noise.
bool FlatSeries::light_is_known() const {
  constexpr double kMostError = 0.01;
  double light_dn = 0, error_dn2 = 0;
  for (int c = 0; c < run_.geometry().channels(); ++c) {
    const TransferLevel& point = levels_[as_index(c)].back();
    light_dn += point.mean_dn;
    error_dn2 += point.mean_variance_dn2 + point.dark_mean_variance_dn2 +
                 point.variance_dn2 /
                     (static_cast<double>(run_.geometry().channel_pixels(c)) * point.frames);
  }
  const double channels = run_.geometry().channels();
  return std::sqrt(error_dn2 / channels) < kMostError * light_dn / channels;
}

// The channel's dark point, and its levels, as they were before the converter's step hid their
// noise or the camera cut it off.
DarkPoint FlatSeries::corrected_dark_point(int channel, PhysicsCalibration& out) {
  const auto c = as_index(channel);
  const DarkPass& dark = common_.pass;
  std::vector<TransferLevel>& levels = levels_[c];
  DarkPoint point = dark_point(channel, run_.geometry(), dark.temporal.variance_dn2()[c], out);
  point.cut_off = dark.zero_share[c] > kMostDarkZeros;
  if (!dark.hidden.empty()) take_hidden_noise(dark.hidden[c], point, levels);
  if (!dark.cut_off.empty())
    take_cut_off(dark.cut_off[c], dark.zero_share[c], dark.floor_code_dn[c], point, levels);
  if (std::any_of(dark.hidden.begin(), dark.hidden.end(), std::mem_fn(&HiddenNoise::hidden)))
    append_dark_point(point, out);
  return point;
}

// Which levels are saturated is known when all are added.
void FlatSeries::fit(PhysicsCalibration& out) {
  out.flat_levels = static_cast<int>(seen_.size());
  for (int c = 0; c < run_.geometry().channels(); ++c) {
    std::vector<TransferLevel>& levels = levels_[as_index(c)];
    const DarkPoint point = corrected_dark_point(c, out);
    cut_off_.push_back(point.cut_off);
    leave_out_saturated(point, levels);
    fits_.push_back(fit_photon_transfer(levels, point));
    append_transfer(c, fits_.back(), levels, out);
  }
  append_fits(fits_, levels_, run_.format().layout, out);
  if (out.dark_zero_share.empty()) return;
  for (std::size_t c = 0; c < out.K_intercept_dn2.size(); ++c)
    out.line_intercept_dn2.push_back(cut_off_[c] ? out.K_intercept_dn2[c] : 0.0);
}

// Keeping each level's mean frame until the saturated ones are known would take memory without
// bound, and taking a sum back loses digits (a saturated level has next to no noise, hence most of
// the weight): the good ones are read again.
void FlatSeries::take_saturated_out_of_patterns() {
  const std::vector<const FrameSet*>& flats = run_.plan().flats;
  std::vector<std::size_t> kept;
  std::int64_t frames = 0;
  bool changed = false;
  for (std::size_t i = 0; i < flats.size(); ++i) {
    std::vector<bool>& good = good_[i];
    for (std::size_t c = 0; c < good.size(); ++c) {
      changed |= good[c] && levels_[c][i].saturated;
      good[c] = good[c] && !levels_[c][i].saturated;
    }
    if (std::find(good.begin(), good.end(), true) == good.end()) continue;
    kept.push_back(i);
    frames += frames_of_level(*flats[i], run_.plan().darks);
  }
  if (!changed) return;
  patterns_ = FlatPatterns(run_.geometry());
  run_.progress().begin("calibrating, saturated flats left out", frames);
  for (const std::size_t i : kept) {
    const MatchingDark own = matching_dark(run_, *flats[i], common_);
    FlatLevel level = measure_level(run_, *flats[i], own, rows_);
    patterns_.add(run_.format(), *flats[i], level, own, good_[i]);
  }
}

bool FlatSeries::saturated_in_any(std::size_t level) const {
  return std::any_of(
      levels_.begin(), levels_.end(),
      [&](const std::vector<TransferLevel>& channel) { return channel[level].saturated; });
}

void FlatSeries::warn_of_full_well(PhysicsCalibration& out) const {
  const double range_dn = run_.format().mean_range_dn();
  std::vector<std::string> names;
  double lowest = range_dn;
  for (std::size_t i = 0; i < seen_.size(); ++i) {
    if (!saturated_in_any(i)) continue;
    names.push_back(seen_[i].name);
    for (const std::vector<TransferLevel>& channel : levels_)
      if (channel[i].saturated) lowest = std::min(lowest, channel[i].mean_dn);
  }
  if (names.empty()) return;
  // Shot noise meets the end a little below it.
  const double limit = run_.settings().saturation_limit, advised = 0.9 * lowest / range_dn;
  out.warnings.push_back(fmt::format(
      "the sensor saturates (or its response has a knee) at {:.4g} DN above black, below white: "
      "there the variance falls while the mean rises. Left out of K and PRNU: {}. Full well and "
      "dynamic range count to there; {}a saturation limit of {:.2f}{}",
      lowest, joined(names), advised < limit ? "use shorter exposures, or " : "",
      std::min(advised, limit), advised < limit ? "" : ", the one in force, is low enough"));
}

FlatReference FlatSeries::reference(const PhysicsCalibration& bias) const {
  return {.dark_sd_dn = mean_of(bias.temporal_sd_dark_dn),
          .frame_sd_dn = mean_of(frame_deviation_dn_),
          .bias_frames = run_.bias().count,
          .row_variance_dn2 = mean_square(bias.sigma_row.mean),
          .column_variance_dn2 = mean_square(bias.sigma_column.mean),
          .row_groups = run_.row_groups(),
          .step_dn = common_.pass.step_dn,
          .codes = common_.pass.codes,
          .black_dn = mean_of(run_.format().black_dn),
          .white_dn = run_.format().white_dn};
}

// What the levels say against themselves, the session and the sensor.
void FlatSeries::judge(PhysicsCalibration& out) {
  const FrameFormat& format = run_.format();
  if (all_bright()) warn_of_unlit_lines(patterns_.response.unlit_lines(), out);
  warn_of_full_well(out);
  for (std::size_t i = 0; i < gains_.size(); ++i)
    if (saturated_in_any(i)) {
      gains_[i] = {};
      seen_[i].successive = {};
    }
  const bool other_light = warn_of_flats(seen_, reference(out), out);
  if (std::find(cut_off_.begin(), cut_off_.end(), true) != cut_off_.end() && !out.K.mean.empty())
    out.warnings.push_back(
        "K rests on the flat frames alone: dark noise that is cut off makes no dark point");
  if (!other_light)  // which explains another variance
    warn_of_gain_map(gains_, {mean_square(out.sigma_row.mean), run_.row_groups()}, out);
  warn_of_image_lag(seen_, common_.pass.successive, out);
  warn_of_colors(format.layout, light_dn_, out);
  warn_of_angles(format.layout, light_dn_, out);
  warn_of_lit_darkness(format, out);
  warn_of_alike_neighbours(common_.pass.neighbours, patterns_.neighbours, out);
}

// The reason against the most levels that are bright enough, of the channels without a response.
std::string FlatSeries::reason_against_response() const {
  std::vector<TransferLevel> bright;
  for (const int c : patterns_.response.channels_without())
    for (const TransferLevel& level : levels_[as_index(c)])
      if (level.mean_dn > kResponseShare * run_.format().range_dn(as_index(c)))
        bright.push_back(level);
  return most_frequent_reason(bright);
}

void FlatSeries::tell_response(PhysicsCalibration& out) const {
  if (!all_bright()) {
    if (!out.K.mean.empty())
      out.warnings.push_back(patterns_.response_missing(run_.format(), reason_against_response()));
    return;
  }
  Response relative = patterns_.response.response({out.sigma_row.mean, out.row_drift.drift});
  widen_by_bend(fits_, relative);
  warn_of_response(response_pattern(relative, run_.geometry()), run_.format().layout, out);
  take_dark_current(patterns_.of_response, relative, out);
  out.prnu_map = std::move(relative.map);
  out.prnu = std::move(relative.prnu);
  out.prnu_stderr = std::move(relative.prnu_stderr);
}

}  // namespace

void measure_flats(const GainRun& run, const DarkPass& dark, PhysicsCalibration& out) {
  MALUS_REQUIRE(out.sigma_row.mean.size() == as_index(run.geometry().channels()) &&
                !out.dark_shading_dn.empty());
  FlatSeries series(run, {dark, out.dark_shading_dn}, {out.sigma_row.mean, out.row_drift.drift});
  for (const FrameSet* flat : run.plan().flats) series.add(*flat);
  series.fit(out);
  series.take_saturated_out_of_patterns();
  series.judge(out);
  series.tell_response(out);
}

}  // namespace malus
