#include "malus/denoise/internal/variance_lines.h"

#include "malus/base/statistics.h"
#include "malus/noise/stabilize.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace malus::internal {
namespace {

constexpr int kPasses = 10;                // of reweighted fits
constexpr double kPooledDeviation = 0.05;  // how far the channels' gains may differ
constexpr double kFallsByChance = 2.0;     // standard errors

// A billionth of the levels' variance.
double least_error_of(const std::vector<VarianceLevel>& levels) {
  double highest = 0;
  for (const VarianceLevel& l : levels) highest = std::max(highest, l.variance);
  return highest > 0 ? 1e-9 * highest : 1.0;
}

// Weight of a level for its distance above a line, in standard errors.
double weight_above(double above) { return above > 0 ? 1.0 / (1.0 + above * above / 9.0) : 1.0; }

// Texture only ever adds variance: levels above the line count less than levels below it.
// A level's error is taken from the fitted variance: its own would favour levels that came out low.
// least_error: what keeps the weight of a level without noise finite.
double weight_of(const VarianceLevel& level, double fitted, double least_error) {
  const double error = level.relative_error * std::max(fitted, 0.1 * level.variance) + least_error;
  return weight_above((level.variance - fitted) / error) / (error * error);
}

// Read noise is not below zero: the slope is no steeper than any level's variance over its signal.
// Of few levels the brightest may hold nothing but the picture's detail, stars on a dark ground,
// and no other would tell.
void limit_slope(const std::vector<VarianceLevel>& levels, VarianceLine& line) {
  constexpr std::size_t kFew = 8;
  constexpr double kErrors = 3.0;
  if (levels.size() >= kFew) return;
  for (const VarianceLevel& l : levels)
    if (l.signal > 0)
      line.slope = std::min(line.slope, l.variance * (1.0 + kErrors * l.relative_error) / l.signal);
}

VarianceLine fit_levels(const std::vector<VarianceLevel>& levels) {
  std::vector<double> x, y, weights(levels.size(), 1.0);
  for (const VarianceLevel& l : levels) {
    x.push_back(l.signal);
    y.push_back(l.variance);
  }
  VarianceLine line;
  line.offset = mean_of(y);
  line.offset_error = levels.front().relative_error * line.offset;
  const auto [low, high] = std::minmax_element(x.begin(), x.end());
  if (!(*high - *low > 1e-6 * std::max(std::abs(*low), std::abs(*high)))) return line;
  const double least_error = least_error_of(levels);
  for (int pass = 0; pass < kPasses; ++pass) {
    const LineFit fit = fit_line(x, y, weights, pass > 0);
    line = {fit.slope, fit.intercept, fit.slope_standard_error, fit.intercept_standard_error};
    for (std::size_t i = 0; i < x.size(); ++i)
      weights[i] = weight_of(levels[i], line.offset + line.slope * x[i], least_error);
  }
  return line;
}

// The line as a curve. None falls below the variance of rounding. Pixels that all have one value,
// or two, do not tell it: where the noise is less than a step, what rounding adds is the picture's.
// A line that begins lower is raised as a whole: as a line it keeps the law of shot noise, without
// which light of few electrons comes out too bright. One whose read noise came out below zero, as
// of an unknown black level, stays above a tenth of the lowest level's variance, and above what
// makes less than a few deviations of a step of its shot noise: stabilised, its samples below 0
// would outweigh all that is bright.
VarianceCurve curve_of(const VarianceLine& line, const std::vector<VarianceLevel>& levels,
                       double rounding_dn2) {
  const double slope = std::max(line.slope, 0.0);
  if (line.offset >= 0) return VarianceCurve::affine(slope, std::max(line.offset, rounding_dn2));
  double lowest = levels.front().variance;
  for (const VarianceLevel& l : levels) lowest = std::min(lowest, l.variance);
  return VarianceCurve::floored_line(
      slope, line.offset,
      std::max(
          {rounding_dn2, 0.1 * lowest, std::pow(Stabilizer::kLeastNegativeSlopes * slope, 2)}));
}

// Channels of one sensor share their gain up to a few per cent: each line is drawn to the mean one.
// Slopes below zero by chance count as well: of a scene of nearly one brightness half of them are,
// and the mean of the others would be far too steep. Those that fall by more than chance have
// texture in the dark and tell nothing.
void pool(std::vector<VarianceLine>& lines) {
  double slope = 0, weight = 0;
  for (const VarianceLine& l : lines)
    if (l.slope_error > 0 && l.slope > -kFallsByChance * l.slope_error) {
      const double w = 1.0 / (l.slope_error * l.slope_error +
                              kPooledDeviation * kPooledDeviation * l.slope * l.slope);
      slope += w * l.slope;
      weight += w;
    }
  slope = weight > 0 ? std::max(slope / weight, 0.0) : 0.0;
  const double prior = kPooledDeviation * slope;
  for (VarianceLine& l : lines) {
    const double variance = l.slope_error * l.slope_error;
    const double trust =
        l.slope > 0 && slope > 0 ? prior * prior / (prior * prior + variance) : 0.0;
    l.slope = slope + trust * (l.slope - slope);
  }
}

// Values divided by a gain.
VarianceLine divided(const VarianceLine& line, double gain) {
  return {line.slope / gain, line.offset / (gain * gain), line.slope_error / gain,
          line.offset_error / (gain * gain)};
}

// How far slopes lie from their mean, in squares of their errors and of what pooling allows.
double disagreement(const std::vector<VarianceLine>& lines) {
  double slope = 0, weight = 0, sum = 0;
  std::vector<double> weights;
  for (const VarianceLine& l : lines) {
    const double allowed = kPooledDeviation * l.slope;
    weights.push_back(1.0 / std::max(l.slope_error * l.slope_error + allowed * allowed, 1e-300));
    slope += weights.back() * l.slope;
    weight += weights.back();
  }
  slope /= weight;
  for (std::size_t k = 0; k < lines.size(); ++k)
    sum += weights[k] * (lines[k].slope - slope) * (lines[k].slope - slope);
  return sum;
}

// The offset that carries the pooled slope through the channel's levels; returns the sum of
// weights.
double fit_offset(const std::vector<VarianceLevel>& levels, VarianceLine& line) {
  double weight = 0;
  const double least_error = least_error_of(levels);
  for (int pass = 0; pass < kPasses; ++pass) {
    double weighted = 0;
    weight = 0;
    for (const VarianceLevel& l : levels) {
      const double w = weight_of(l, line.offset + line.slope * l.signal, least_error);
      weighted += w * (l.variance - line.slope * l.signal);
      weight += w;
    }
    line.offset = weighted / weight;
  }
  return weight;
}

// All of it shot noise: of levels whose line tells of read noise below zero. They are of nearly one
// brightness and differ in texture more than in light, or texture grows with the light.
VarianceLine shot_noise_of(const std::vector<VarianceLevel>& levels) {
  std::vector<double> slopes;
  for (const VarianceLevel& l : levels)
    if (l.signal > 0) slopes.push_back(l.variance / l.signal);
  VarianceLine line;
  if (slopes.empty()) return line;
  line.slope = median_of(std::move(slopes));
  const double least_error = least_error_of(levels);
  for (int pass = 0; pass < kPasses; ++pass) {
    double products = 0, squares = 0;
    for (const VarianceLevel& l : levels) {
      const double w = weight_of(l, line.slope * l.signal, least_error);
      products += w * l.signal * l.variance;
      squares += w * l.signal * l.signal;
    }
    line.slope = products / squares;
    line.slope_error = 1 / std::sqrt(squares);
  }
  return line;
}

}  // namespace

void VarianceLines::add(std::vector<VarianceLevel> of_channel, bool black_known) {
  black_is_known = black_known;
  for (VarianceLevel& l : of_channel) {
    highest_variance = std::max(highest_variance, l.variance);
    l.variance = std::max(l.variance, rounding_dn2);
  }
  lines.push_back(fit_levels(of_channel));
  if (black_known) limit_slope(of_channel, lines.back());
  levels.push_back(std::move(of_channel));
}

bool VarianceLines::agree_without(const std::vector<double>& of_channels) const {
  std::vector<VarianceLine> without;
  for (std::size_t k = 0; k < lines.size(); ++k)
    without.push_back(divided(lines[k], of_channels[k]));
  return disagreement(without) < disagreement(lines);
}

void VarianceLines::settle() {
  for (std::size_t k = 0; k < lines.size(); ++k) lines[k] = divided(lines[k], gain(k));
  pool(lines);
  for (std::size_t k = 0; k < lines.size(); ++k) lines[k] = divided(lines[k], 1.0 / gain(k));
  weights.clear();
  for (std::size_t k = 0; k < lines.size(); ++k) {
    weights.push_back(fit_offset(levels[k], lines[k]));
    if (black_is_known && lines[k].offset < 0) lines[k] = shot_noise_of(levels[k]);
  }
}

void VarianceLines::refit() {
  for (std::size_t k = 0; k < lines.size(); ++k) lines[k] = fit_levels(levels[k]);
  settle();
}

std::vector<VarianceCurve> VarianceLines::curves(double kept) const {
  std::vector<VarianceLevel> all;
  for (std::size_t k = 0; k < levels.size(); ++k)
    for (const VarianceLevel& level : levels[k]) all.push_back(scaled(level, 1.0 / gain(k)));
  VarianceLine common = fit_levels(all);
  if (black_is_known && common.offset < 0) common = shot_noise_of(all);
  std::vector<VarianceCurve> result;
  for (std::size_t k = 0; k < lines.size(); ++k) {
    const VarianceLine of_all = divided(common, 1.0 / gain(k));
    VarianceLine line;
    line.slope = of_all.slope + kept * (lines[k].slope - of_all.slope);
    line.offset = of_all.offset + kept * (lines[k].offset - of_all.offset);
    result.push_back(curve_of(line, levels[k], rounding_dn2));
  }
  return result;
}

}  // namespace malus::internal
