#include "malus/denoise/internal/texture_removal.h"

#include "malus/base/statistics.h"
#include "malus/denoise/internal/noise_floor.h"
#include "malus/denoise/internal/quiet_patches.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace malus::internal {
namespace {

constexpr double kChance = 2.0;  // standard errors
constexpr int kFloorPasses = 2;
constexpr int kQuietPasses = 2;  // the first one's lines may not rise with the light as they should
// Of levels that are mostly texture beside those of quiet patches: of a channel's, and of the mean
// over the channels.
constexpr double kErrorOfMean = 0.25;
constexpr double kErrorInTexture = 1.0;
constexpr double kUnlike = 1.5;  // times as bright, beside what is usual of the channels
constexpr double kUnbounded = std::numeric_limits<double>::infinity();
constexpr double kRoundings = 2.4;       // of which noise must be more to be seen in patches
constexpr double kEnoughRange = 0.4;     // of the levels' brightnesses
constexpr double kLittleTexture = 0.05;  // what the floors may err: lines are left alone
constexpr double kTexture = 0.2;         // from here on nothing is kept of how channels differ

// How much of the channels' own lines is kept beside that of them all.
double kept_of(double noise_share) {
  return std::clamp(1.0 - (1.0 - noise_share) / kTexture, 0.0, 1.0);
}

// From the darkest level's signal to the brightest's.
double range_of(const std::vector<std::vector<VarianceLevel>>& levels) {
  double low = levels.front().front().signal, high = low;
  for (const std::vector<VarianceLevel>& own : levels)
    for (const VarianceLevel& l : own) {
      low = std::min(low, l.signal);
      high = std::max(high, l.signal);
    }
  return high - low;
}

// The signal from which on a line lies above a variance.
double signal_at(const VarianceLine& line, double variance) {
  if (line.slope > 0) return (variance - line.offset) / line.slope;
  return (line.offset < variance ? 1.0 : -1.0) * std::numeric_limits<double>::infinity();
}

// The noise's share of the variance against the signal: that of the floors, drawn to their mean as
// far as their own errors explain how they differ, and straight between them. Floors of a small
// part of the levels' brightnesses (every patch of a board is half black) tell no more than their
// mean.
class NoiseShare {
 public:
  NoiseShare(std::vector<NoiseFloor> floors, const std::vector<std::vector<VarianceLevel>>& levels)
      : floors_(std::move(floors)) {
    std::vector<double> ratios;
    for (const NoiseFloor& f : floors_) ratios.push_back(f.ratio);
    mean_ = mean_of(ratios);
    if (floors_.size() < 2) return;
    const double deviation = standard_deviation_of(ratios);
    error_ = floors_.front().relative_error;
    const double by_chance = std::pow(mean_ * error_, 2), found = deviation * deviation;
    double kept = found > 0 ? std::max(1.0 - kChance * by_chance / found, 0.0) : 0.0;
    if (floors_.back().signal_dn - floors_.front().signal_dn < kEnoughRange * range_of(levels))
      kept = 0;
    error_ *= kept;
    for (NoiseFloor& f : floors_) f.ratio = mean_ + kept * (f.ratio - mean_);
  }
  double mean() const { return mean_; }
  /// One standard error of a level's against another's.
  double relative_error() const { return error_; }
  double at(double signal_dn) const {
    if (signal_dn <= floors_.front().signal_dn) return floors_.front().ratio;
    for (std::size_t i = 1; i < floors_.size(); ++i) {
      const NoiseFloor &a = floors_[i - 1], &b = floors_[i];
      if (signal_dn < b.signal_dn)
        return a.ratio +
               (b.ratio - a.ratio) * (signal_dn - a.signal_dn) / (b.signal_dn - a.signal_dn);
    }
    return floors_.back().ratio;
  }

 private:
  std::vector<NoiseFloor> floors_;
  double mean_ = 1, error_ = 0;
};

// Noise never falls with the light, and never rises more than light does: what any level shows
// bounds it at all others. A level above its bounds holds texture, and is set between the most and
// the least that the level which bounds it tells.
void bound_by(const std::vector<VarianceLevel>& shown, bool black_known,
              std::vector<VarianceLevel>& levels) {
  for (VarianceLevel& level : levels) {
    double most = kUnbounded, least = 0;
    for (const VarianceLevel& other : shown) {
      const double lit = black_known && level.signal > 0 && other.signal > 0
                             ? level.signal / other.signal
                             : (level.signal > other.signal ? kUnbounded : 1.0);
      if (lit == kUnbounded) continue;
      const double bound =
          other.variance * (1 + kChance * other.relative_error) * std::max(lit, 1.0);
      if (bound >= most) continue;
      most = bound;
      least = other.variance * std::min(lit, 1.0);
    }
    if (level.variance * (1 - kChance * level.relative_error) <= most) continue;
    level.variance = std::sqrt(least * most);
    level.relative_error = std::max(level.relative_error, 0.25 * std::log(most / least));
  }
}

// Level by level the mean of the channels, which share their gain but for the digital one.
std::vector<VarianceLevel> mean_of_channels(const VarianceLines& lines) {
  const std::vector<std::vector<VarianceLevel>>& levels = lines.levels;
  std::size_t count = levels.front().size();
  for (const std::vector<VarianceLevel>& own : levels) count = std::min(count, own.size());
  std::vector<VarianceLevel> mean(count, VarianceLevel{0, 0, 0});
  const double share = 1.0 / static_cast<double>(levels.size());
  for (std::size_t k = 0; k < levels.size(); ++k)
    for (std::size_t i = 0; i < count; ++i) {
      const VarianceLevel own = scaled(levels[k][i], 1.0 / lines.gain(k));
      mean[i].signal += share * own.signal;
      mean[i].variance += share * own.variance;
      mean[i].relative_error += share * own.relative_error;
    }
  return mean;
}

// Of the sums of the curves over the levels' signals.
double share_left(const std::vector<std::vector<VarianceLevel>>& levels,
                  const std::vector<VarianceCurve>& before,
                  const std::vector<VarianceCurve>& after) {
  double sum_before = 0, sum_after = 0;
  for (std::size_t k = 0; k < levels.size(); ++k)
    for (const VarianceLevel& level : levels[k]) {
      sum_before += before[k](level.signal);
      sum_after += after[k](level.signal);
    }
  return std::min(sum_after / sum_before, 1.0);
}

// Mean of a channel's signals.
double usual_signal(const std::vector<VarianceLevel>& levels) {
  double sum = 0;
  for (const VarianceLevel& l : levels) sum += l.signal;
  return sum / static_cast<double>(levels.size());
}

// What a quiet patch tells of every channel. The large cells of colour polarization may have ink on
// some channels and paper on others: the quiet pixels are the dark ones, and where the variance is
// thought to rise less than it does they would tell too little of the bright ones. Those lie
// between that and what light alone makes of the dark ones' noise.
std::vector<VarianceLevel> told_of_channels(const QuietPatches& quiet,
                                            const std::vector<VarianceCurve>& curves,
                                            const VarianceLines& lines, double root,
                                            const std::vector<std::vector<VarianceLevel>>& levels) {
  std::vector<VarianceLevel> told;
  std::vector<double> brightness;  // of usual
  for (std::size_t k = 0; k < levels.size(); ++k) {
    const double signal = quiet.signal_dn[k];
    told.push_back({signal, std::max(quiet.ratio * curves[k](signal), lines.rounding_dn2),
                    quiet.relative_error * root});
    brightness.push_back(signal / usual_signal(levels[k]));
  }
  const auto dark = static_cast<std::size_t>(
      std::min_element(brightness.begin(), brightness.end()) - brightness.begin());
  if (!lines.black_is_known || !(brightness[dark] > 0)) return told;
  const VarianceLevel least = scaled(told[dark], 1.0 / lines.gain(dark));
  for (std::size_t k = 0; k < levels.size(); ++k) {
    if (brightness[k] < kUnlike * brightness[dark]) continue;
    const double gain = lines.gain(k), most = least.variance * told[k].signal / least.signal * gain;
    if (most <= told[k].variance) continue;
    told[k].relative_error =
        std::max(told[k].relative_error, 0.25 * std::log(most / told[k].variance));
    told[k].variance = std::sqrt(told[k].variance * most);
  }
  return told;
}

// Smooth patches between the texture become levels of their own, where they clearly tell of less
// noise than the lines. Returns the share of the variance that is left.
double hear_quiet_patches(const Image& dn, const SensorLayout& layout,
                          const std::vector<float>& saturated_dn,
                          const std::vector<double>& dark_dn, VarianceLines& lines) {
  const std::vector<VarianceCurve> before = lines.curves(1.0);
  const std::vector<std::vector<VarianceLevel>> levels = lines.levels;
  std::vector<VarianceLevel> usual = mean_of_channels(lines);
  for (VarianceLevel& level : usual)
    level.relative_error = std::max(level.relative_error, kErrorOfMean);
  const double root = std::sqrt(static_cast<double>(levels.size()));
  for (int pass = 0; pass <= kQuietPasses; ++pass) {
    // Of channels whose lines differ by texture the noisiest ones' would seem quiet.
    const std::vector<VarianceCurve> curves = pass == 0 ? before : lines.curves(0.0);
    const std::vector<QuietPatches> quiet =
        quiet_patches(dn, layout, curves, saturated_dn, dark_dn);
    if (pass <= 1 && std::none_of(quiet.begin(), quiet.end(), [](const QuietPatches& q) {
          return q.ratio * (1 + kChance * q.relative_error) < 1 - kLittleTexture;
        }))
      return 1.0;
    if (pass == 0) continue;
    std::vector<std::vector<VarianceLevel>> told_of(levels.size());
    for (const QuietPatches& q : quiet) {
      const std::vector<VarianceLevel> of_patch = told_of_channels(q, curves, lines, root, levels);
      for (std::size_t k = 0; k < levels.size(); ++k) told_of[k].push_back(of_patch[k]);
    }
    for (std::size_t k = 0; k < levels.size(); ++k) {
      std::vector<VarianceLevel>& told = told_of[k];
      std::vector<VarianceLevel> shown;
      for (const VarianceLevel& level : usual) shown.push_back(scaled(level, lines.gain(k)));
      shown.insert(shown.end(), told.begin(), told.end());
      bound_by(shown, lines.black_is_known, told);
      std::vector<VarianceLevel>& own = lines.levels[k] = levels[k];
      bound_by(told, lines.black_is_known, own);
      for (VarianceLevel& level : own)
        level.relative_error = std::max(level.relative_error, kErrorInTexture);
      own.insert(own.end(), told.begin(), told.end());
    }
    lines.refit();
  }
  return share_left(lines.levels, before, lines.curves(1.0));
}

}  // namespace

double take_texture_off(const Image& dn, const SensorLayout& layout,
                        const std::vector<float>& saturated_dn, bool hear_quiet,
                        VarianceLines& lines) {
  const std::vector<VarianceCurve> most = lines.curves(1.0);
  // What is cut off has less variance than the lines say.
  constexpr double kFarFromFloor = 2.5;  // deviations
  std::vector<double> dark_dn;
  for (std::size_t k = 0; k < lines.lines.size(); ++k) {
    dark_dn.push_back(signal_at(lines.lines[k], kRoundings * lines.rounding_dn2));
    if (!lines.floor_dn.empty() && std::isfinite(lines.floor_dn[k]))
      dark_dn.back() =
          std::max(dark_dn.back(), lines.floor_dn[k] + kFarFromFloor * std::sqrt(most[k](0)));
  }
  double noise_share = 1;
  for (int pass = 0; pass < kFloorPasses; ++pass) {
    std::vector<VarianceCurve> curves = lines.curves(kept_of(noise_share));
    std::vector<NoiseFloor> floors = noise_floor(dn, layout, curves, saturated_dn, dark_dn);
    if (floors.empty()) break;
    if (pass == 0) {
      const double seen = NoiseShare(floors, lines.levels).mean();
      if (seen > 1.0 - kLittleTexture) break;
      // Of channels whose lines differ by texture the noisiest one's pixels would seem quietest.
      curves = lines.curves(kept_of(seen));
      floors = noise_floor(dn, layout, curves, saturated_dn, dark_dn);
      if (floors.empty()) break;
    }
    const NoiseShare share(std::move(floors), lines.levels);
    noise_share = std::min(noise_share * share.mean(), 1.0);
    // What the floors err is the same for all channels: pooling must not average it away.
    const double error =
        share.relative_error() * std::sqrt(static_cast<double>(lines.lines.size()));
    for (std::size_t k = 0; k < lines.lines.size(); ++k)
      for (VarianceLevel& level : lines.levels[k]) {
        level.variance =
            std::min(share.at(level.signal) * curves[k](level.signal), most[k](level.signal));
        level.relative_error = std::hypot(level.relative_error, error);
      }
    lines.refit();
  }
  if (hear_quiet) noise_share *= hear_quiet_patches(dn, layout, saturated_dn, dark_dn, lines);
  return 1.0 - noise_share;
}

}  // namespace malus::internal
