#include "malus/calibrate/internal/saturation.h"

#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

constexpr double kOfGain = 5.0, kOfLargest = 4.0;  // standard errors
constexpr double kShortfall = 0.25;
constexpr std::size_t kTellsGain = 3;  // levels

// A level's variance beyond the dark one, with the error that it would have at this gain.
struct Excess {
  double signal_dn, variance_dn2, error_dn2;
};

bool quieter(const Excess& a, const Excess& b) { return a.variance_dn2 < b.variance_dn2; }

Excess excess_of(const TransferLevel& level, const DarkPoint& dark, double gain) {
  double error = flat_error_dn4(level, dark, gain);
  error += level.dark_frames < 2 ? dark.variance_stderr_dn2 * dark.variance_stderr_dn2
                                 : dark_error_dn4(level, dark, gain);
  return {level.mean_dn, level.variance_dn2 - level.dark_variance_dn2, std::sqrt(error)};
}

// Gain and its error by a weighted median, which no single level decides.
struct MedianGain {
  double gain, error;
};

MedianGain median_gain(const std::vector<Excess>& levels) {
  std::vector<std::pair<double, double>> gains;  // and weights
  double total = 0.0, below = 0.0;
  for (const Excess& level : levels) {
    gains.emplace_back(level.variance_dn2 / level.signal_dn,
                       std::pow(level.signal_dn / level.error_dn2, 2));
    total += gains.back().second;
  }
  std::sort(gains.begin(), gains.end());
  std::size_t i = 0;
  while (i + 1 < gains.size() && below + gains[i].second < 0.5 * total) below += gains[i++].second;
  constexpr double kOfMedian = 1.2533141373155003;  // error of a median over that of a mean
  return {gains[i].first, kOfMedian / std::sqrt(total)};
}

bool is_past(const TransferLevel& level, const std::vector<Excess>& darker, const DarkPoint& dark) {
  if (darker.size() < 2) return false;
  const MedianGain median = median_gain(darker);
  if (!(median.gain > 0)) return false;
  const Excess own = excess_of(level, dark, median.gain);
  const double expected = median.gain * own.signal_dn;
  const double shortfall = expected - own.variance_dn2;
  if (shortfall < kOfGain * std::hypot(own.error_dn2, median.error * own.signal_dn)) return false;
  const auto largest = std::max_element(darker.begin(), darker.end(), quieter);
  const double fall = largest->variance_dn2 - own.variance_dn2;
  return shortfall > kShortfall * expected ||
         fall > kOfLargest * std::hypot(own.error_dn2, largest->error_dn2);
}

// Of the levels in this order, which lie past the maximum; the first `loud` never do.
std::vector<bool> past_maximum(const std::vector<TransferLevel>& levels,
                               const std::vector<std::size_t>& order, std::size_t loud,
                               const std::vector<Excess>& excess, const DarkPoint& dark) {
  std::vector<bool> past(order.size(), false);
  std::vector<Excess> darker;
  for (std::size_t k = 0; k < order.size(); ++k) {
    past[k] = k >= loud && is_past(levels[order[k]], darker, dark);
    if (!past[k]) darker.push_back(excess[k]);
  }
  for (std::size_t k = order.size(); k-- > 0;)  // all brighter ones, too
    past[k] = past[k] && (k + 1 == order.size() || past[k + 1]);
  return past;
}

// Enough levels of which none is louder than the gain of most explains.
bool none_is_loud(const std::vector<Excess>& levels) {
  if (levels.size() < kTellsGain) return false;
  const MedianGain median = median_gain(levels);
  return std::all_of(levels.begin(), levels.end(), [&](const Excess& level) {
    return level.variance_dn2 - median.gain * level.signal_dn <
           kOfGain * std::hypot(level.error_dn2, median.error * level.signal_dn);
  });
}

// How many levels lie below the last rise of the variance: at a full well it falls, and then so do
// all that are past it. Beyond a knee it rises again, but not at once to what it was: that is no
// rise, if none of the levels before the knee is loud.
std::size_t below_last_rise(const std::vector<Excess>& excess, const std::vector<bool>& past) {
  std::vector<Excess> before;
  for (std::size_t k = 0; k < excess.size(); ++k)
    if (!past[k]) before.push_back(excess[k]);
  const double most = none_is_loud(before)
                          ? std::max_element(before.begin(), before.end(), quieter)->variance_dn2
                          : 0;
  const Excess* loudest = nullptr;  // of the brighter ones
  for (std::size_t k = excess.size(); k-- > 0 && past[k];) {
    if (loudest && loudest->variance_dn2 > most &&
        loudest->variance_dn2 - excess[k].variance_dn2 >
            kOfLargest * std::hypot(excess[k].error_dn2, loudest->error_dn2))
      return k + 1;
    if (!loudest || excess[k].variance_dn2 > loudest->variance_dn2) loudest = &excess[k];
  }
  return 0;
}

}  // namespace

std::vector<bool> saturated_levels(const std::vector<TransferLevel>& levels,
                                   const DarkPoint& dark) {
  std::vector<std::size_t> order;
  std::vector<double> gains;
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const TransferLevel& level = levels[i];
    if (level.frames < 2 || level.at_white || !(level.mean_dn > 0)) continue;
    order.push_back(i);
    gains.push_back((level.variance_dn2 - level.dark_variance_dn2) / level.mean_dn);
  }
  std::vector<bool> saturated(levels.size(), false);
  if (order.size() < 3) return saturated;
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return levels[a].mean_dn < levels[b].mean_dn; });
  const double rough = std::max(median_of(gains), 0.0);
  std::vector<Excess> excess;
  for (const std::size_t i : order) excess.push_back(excess_of(levels[i], dark, rough));
  std::vector<bool> past = past_maximum(levels, order, 0, excess, dark);
  while (const std::size_t loud = below_last_rise(excess, past))
    past = past_maximum(levels, order, loud, excess, dark);
  for (std::size_t k = 0; k < order.size(); ++k) saturated[order[k]] = past[k];
  return saturated;
}

}  // namespace malus
