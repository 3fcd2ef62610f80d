#include "malus/calibrate/internal/transfer_results.h"

#include "malus/base/index.h"
#include "malus/calibrate/internal/channel_words.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr std::size_t kFewLevels = 5;

std::size_t usable(const std::vector<TransferLevel>& levels) {
  return static_cast<std::size_t>(
      std::count_if(levels.begin(), levels.end(),
                    [](const TransferLevel& level) { return level.refused.empty(); }));
}

// Whether the values from `begin` to `end`, which rise, are one but for lamps and offsets.
template <class Iterator>
bool alike(Iterator begin, Iterator end) {
  constexpr double kMost = 1.5;
  return *(end - 1) < kMost * *begin;
}

// Of exposures in two units the light per second falls into two groups, a thousand or a million
// apart.
void warn_of_exposure_units(PhysicsCalibration& out) {
  constexpr double kNear = 1.25;
  constexpr std::size_t kFewest = 3;
  std::vector<double> per_second;
  for (const PhotonTransferPoint& point : out.transfer)
    if (point.channel == 0 && point.exposure_s > 0 && point.mean_dn > 0 && !point.at_white &&
        !point.saturated)
      per_second.push_back(point.mean_dn / point.exposure_s);
  if (per_second.size() < kFewest) return;
  std::sort(per_second.begin(), per_second.end());
  for (auto split = per_second.begin() + 1; split != per_second.end(); ++split)
    for (const double units : {1e3, 1e6}) {
      const double ratio = *split / *(split - 1) / units;
      if (!(ratio > 1 / kNear && ratio < kNear)) continue;
      if (!alike(per_second.begin(), split) || !alike(split, per_second.end())) continue;
      out.warnings.push_back(fmt::format(
          "{} of {} light levels have {:.0f} times less light for their exposure than the others: "
          "are all exposures in seconds? Linearity, dark frames and dark current go by them",
          split - per_second.begin(), per_second.size(), units));
      return;
    }
}

// Contract: all fits are known.
void warn_of_other_light(const std::vector<Estimate<TransferFit>>& fits, const SensorLayout& layout,
                         PhysicsCalibration& out) {
  std::vector<std::string> channels;
  for (int c = 0; c < layout.channels(); ++c)
    if (fits[as_index(c)]->exposures_tell_no_light) channels.push_back(layout.channel_name(c));
  if (!channels.empty())
    out.warnings.push_back(fmt::format(
        "{}: the light of the levels does not follow their exposures: was the lamp turned between "
        "levels, or are exposures wrong? K does not go by them, the linearity error does",
        channels_text(channels, layout)));
}

}  // namespace

std::string most_frequent_reason(const std::vector<TransferLevel>& levels) {
  std::map<Refusal, std::vector<const std::string*>> reasons;
  for (const TransferLevel& level : levels)
    if (!level.refused.empty()) reasons[level.refused.reason].push_back(&level.refused.words);
  const auto most = std::max_element(
      reasons.begin(), reasons.end(),
      [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); });
  if (most == reasons.end()) return {};
  return fmt::format("{} of {}: {}", most->second.size(), levels.size(), *most->second.front());
}

void append_transfer(int channel, const Estimate<TransferFit>& fit,
                     const std::vector<TransferLevel>& levels, PhysicsCalibration& out) {
  for (std::size_t i = 0; i < levels.size(); ++i) {
    PhotonTransferPoint point;
    point.channel = channel;
    point.exposure_s = levels[i].exposure_s;
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

void append_fits(const std::vector<Estimate<TransferFit>>& fits,
                 const std::vector<std::vector<TransferLevel>>& levels, const SensorLayout& layout,
                 PhysicsCalibration& out) {
  std::vector<std::string> scattered, bent;
  double most_chi_square = 0.0, most_excess_dn2 = 0.0, most_percent = 0.0;
  for (int c = 0; c < layout.channels(); ++c) {
    const auto& fit = fits[as_index(c)];
    if (!fit) {
      // With two levels or more it is no refusal that the fit lacks.
      const std::string refused =
          usable(levels[as_index(c)]) < 2 ? most_frequent_reason(levels[as_index(c)]) : "";
      out.warnings.push_back(
          fmt::format("{}: the gain K is not known{}: {}{}{}", layout.channel_name(c),
                      layout.channels() > 1 ? ", so K of no channel is kept" : "", fit.reason(),
                      refused.empty() ? "" : "; ", refused));
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
  if (const std::size_t used = usable(levels.front()); used < kFewLevels) {
    const std::string refused = most_frequent_reason(levels.front());
    out.warnings.push_back(fmt::format(
        "K rests on {} light levels; {} or more show whether the sensor is linear{}", used,
        kFewLevels, refused.empty() ? "" : fmt::format(" (left out are {})", refused)));
  }
  warn_of_exposure_units(out);
  warn_of_other_light(fits, layout, out);
  if (!bent.empty())
    out.warnings.push_back(fmt::format(
        "{}: the sensor is not linear (or its light or dark frames do not match the session file): "
        "K of all levels differs by up to {:+.1f} % from that without light, which its standard "
        "error now holds; K is nearer to it with a lower saturation limit",
        channels_text(bent, layout), most_percent));
  if (!scattered.empty())
    out.warnings.push_back(fmt::format(
        "{}: the photon-transfer curve is not a straight line within its sampling errors (χ² per "
        "level up to {:.1f}); K's standard error is widened by a scatter of up to {:.3g} DN² per "
        "level",
        channels_text(scattered, layout), most_chi_square, most_excess_dn2));
}

}  // namespace malus
