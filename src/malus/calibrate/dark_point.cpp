#include "malus/calibrate/internal/dark_point.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/internal/row_drift_fit.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <fmt/format.h>

namespace malus {
namespace {

// Fourth moment over the squared second, minus the 3 of a normal distribution, of the residuals of
// dark pixels; those beyond the kept cells count as the last one. 0 where none are kept.
double dark_excess_kurtosis(int channel, const PhysicsCalibration& bias) {
  if (bias.residual_counts.size() <= as_index(channel)) return 0.0;
  const std::vector<double>& counts = bias.residual_counts[as_index(channel)];
  double samples = 0, second = 0, fourth = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const double square = std::pow(static_cast<double>(i) + 0.5, 2);
    samples += counts[i];
    second += counts[i] * square;
    fourth += counts[i] * square * square;
  }
  return second > 0 ? samples * fourth / (second * second) - 3.0 : 0.0;
}

// Whether the line can do without these.
template <class IsOne>
bool enough_levels_without(const IsOne& is_one, const std::vector<TransferLevel>& levels) {
  constexpr std::ptrdiff_t kFewest = 3;
  return std::count_if(levels.begin(), levels.end(), [&](const TransferLevel& level) {
           return level.refused.empty() && !is_one(level);
         }) >= kFewest;
}

// Electrons of light and of dark current have one shot noise: it rises with both levels together.
// 0 where no level tells.
double rough_gain(const DarkPoint& dark, const std::vector<TransferLevel>& levels) {
  std::vector<double> gains;
  for (const TransferLevel& level : levels) {
    const double signal_dn = level.mean_dn + std::max(level.dark_current_dn, 0.0);
    if (level.refused.empty() && signal_dn > 0)
      gains.push_back((level.variance_dn2 - dark.variance_dn2) / signal_dn);
  }
  return gains.empty() ? 0.0 : std::max(median_of(gains), 0.0);
}

// The level without light is that of rounded values, too, and all levels that were counted from one
// at the same place in a code share its error.
void take_hidden_level(const HiddenNoise& hidden, TransferLevel& level) {
  if (!hidden.rounds_alike(level.dark_current_dn)) {
    level.mean_variance_dn2 += hidden.mean_doubt_dn2;
    return;
  }
  level.mean_dn += hidden.shift_dn;
  level.dark_mean_variance_dn2 +=
      hidden.known() ? hidden.mean_stderr_dn * hidden.mean_stderr_dn : hidden.mean_doubt_dn2;
}

// Noise that the step does not hide, but of little more than half a step: rounding makes of it what
// its place in a code does.
void take_place_in_code(const HiddenNoise& hidden, DarkPoint& dark,
                        std::vector<TransferLevel>& levels) {
  dark.variance_stderr_dn2 =
      std::hypot(dark.variance_stderr_dn2, hidden.variance_doubt_dn2(dark.variance_dn2));
  for (TransferLevel& level : levels)
    level.rounding_error_dn2 = std::hypot(
        hidden.variance_doubt_dn2(level.variance_dn2),
        level.dark_frames >= 2 ? hidden.variance_doubt_dn2(level.dark_variance_dn2) : 0.0);
}

}  // namespace

DarkPoint dark_point(int channel, const MosaicGeometry& geometry, double variance_dn2,
                     const PhysicsCalibration& bias) {
  DarkPoint point;
  point.variance_dn2 = variance_dn2;
  point.row_variance_dn2 = std::pow(bias.sigma_row.mean[as_index(channel)], 2);
  point.pixels = geometry.channel_pixels(channel);
  const int groups = geometry.channel_groups(channel);
  point.row_groups = groups / (1.0 + drift_of_variances(bias.row_drift.drift, groups,
                                                        geometry.group_stride(channel), 0));
  point.column_variance_dn2 = std::pow(bias.sigma_column.mean[as_index(channel)], 2);
  point.columns = geometry.channel_cols(channel);
  const double pixel =
      std::max(point.variance_dn2 - point.row_variance_dn2 - point.column_variance_dn2, 0.0);
  point.fourth_cumulant_dn4 = dark_excess_kurtosis(channel, bias) * pixel * pixel;
  point.variance_stderr_dn2 = std::sqrt(variance_error_dn4(0.0, bias.bias_frames, point, 0.0));
  return point;
}

void take_hidden_noise(const HiddenNoise& hidden, DarkPoint& dark,
                       std::vector<TransferLevel>& levels) {
  if (!hidden.hidden) {
    take_place_in_code(hidden, dark, levels);
    return;
  }
  dark.variance_dn2 = hidden.variance_dn2 + hidden.rounding_dn2;
  dark.variance_stderr_dn2 = hidden.variance_stderr_dn2;
  if (hidden.known()) dark.cut_off = false;
  const auto is_narrow = [&](const TransferLevel& level) {
    return level.variance_dn2 < hidden.widest_codes_dn2;
  };
  const bool enough = enough_levels_without(is_narrow, levels);
  for (TransferLevel& level : levels)
    if (enough && level.refused.empty() && is_narrow(level))
      level.refused = {
          Refusal::kHidden,
          fmt::format(
              "the variance, {:.2g} DN², is below {:.2g} DN²: the converter's step hides its noise",
              level.variance_dn2, hidden.widest_codes_dn2)};
  const double gain = rough_gain(dark, levels);
  for (TransferLevel& level : levels) {
    level.rounding_error_dn2 = hidden.variance_doubt_dn2(level.variance_dn2);
    if (level.dark_frames >= 2 && level.dark_variance_dn2 > hidden.widest_codes_dn2) continue;
    take_hidden_level(hidden, level);
    level.dark_variance_dn2 = dark.variance_dn2 + gain * std::max(level.dark_current_dn, 0.0);
    level.dark_frames = level.dark_set = 0;
  }
}

void append_dark_point(const DarkPoint& dark, PhysicsCalibration& out) {
  out.dark_point_dn2.push_back(dark.variance_dn2);
  out.dark_point_stderr_dn2.push_back(dark.variance_stderr_dn2);
}

void settle_dark_points(const std::vector<HiddenNoise>& hidden, PhysicsCalibration& out) {
  for (std::size_t c = 0; c < out.dark_point_dn2.size(); ++c) {
    if (hidden[c].hidden) continue;
    const double sd = out.temporal_sd_dark_dn[c];
    out.dark_point_dn2[c] = sd * sd;
    out.dark_point_stderr_dn2[c] = 2.0 * sd * out.temporal_sd_dark_stderr_dn[c];
  }
}

void take_cut_off(const CutOffNoise& cut, double zero_share, double lowest_dn, DarkPoint& dark,
                  std::vector<TransferLevel>& levels) {
  if (!cut.known) return;
  if (!cut.by_law) dark.cut_off = false;  // a law errs by more than it knows
  const double taken_dn2 = cut.variance_dn2 + cut.rows_dn2;
  dark.variance_dn2 += taken_dn2;
  dark.variance_stderr_dn2 = std::hypot(dark.variance_stderr_dn2, cut.variance_stderr_dn2);
  const auto is_cut_off = [](const TransferLevel& level) {
    return level.zero_share > kMostSilentZeros;
  };
  const bool enough = enough_levels_without(is_cut_off, levels);
  for (TransferLevel& level : levels) {
    const double share = level.dark_zero_share / zero_share;  // cut.known: some are 0
    level.dark_variance_dn2 += share * taken_dn2;
    level.mean_dn += share * cut.shift_dn;
    if (enough && level.refused.empty() && is_cut_off(level))
      level.refused = {Refusal::kCutOff,
                       fmt::format("{:.2g} % of the pixels are cut off at {:g} DN, above {:g} %",
                                   100 * level.zero_share, lowest_dn, 100 * kMostSilentZeros)};
  }
}

}  // namespace malus
