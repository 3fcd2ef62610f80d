#include "malus/calibrate/internal/photon_transfer.h"

#include "malus/base/chi_square.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/calibrate/internal/response_bend.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr double kHuber = 3.0;

struct Points {
  std::vector<double> x, y, variance, huber;
  std::vector<std::size_t> set;
  std::vector<double> shared;  ///< per set: variance of the error that its points have in common
  std::size_t size() const { return x.size(); }
};

// Shot noise of the dark current that a level's exposure has and the bias frames' has not.
double dark_current_dn2(const TransferLevel& level, const DarkPoint& dark) {
  return level.dark_variance_dn2 - dark.variance_dn2;
}

// Sums over points that share an error of variance D beside their own 1/w: the inverse of the
// covariance diag(1/w) + D 1 1' is diag(w) - w w' D / (1 + D Σw) (Sherman and Morrison, Ann. Math.
// Statist. 21, 1950).
struct Sums {
  double w = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  void add(double weight, double px, double py) {
    w += weight;
    x += weight * px;
    y += weight * py;
    xx += weight * px * px;
    xy += weight * px * py;
    yy += weight * py * py;
  }
  double take_out(double shared) const { return shared / (1.0 + shared * w); }
  void merge(const Sums& set, double shared) {
    const double f = set.take_out(shared);
    w += set.w - f * set.w * set.w;
    x += set.x - f * set.x * set.w;
    y += set.y - f * set.y * set.w;
    xx += set.xx - f * set.x * set.x;
    xy += set.xy - f * set.x * set.y;
    yy += set.yy - f * set.y * set.y;
  }
};

double weight_of(const Points& points, std::size_t i, double excess_dn4) {
  return points.huber[i] / (points.variance[i] + excess_dn4);
}

// Per set, of the points' distances from a line (zero for the points themselves).
std::vector<Sums> sums_of(const Points& points, double excess_dn4, const LineFit& line = {}) {
  std::vector<Sums> sets(points.shared.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    sets[points.set[i]].add(weight_of(points, i, excess_dn4), points.x[i],
                            points.y[i] - line.intercept - line.slope * points.x[i]);
  return sets;
}

Sums merged(const std::vector<Sums>& sets, const std::vector<double>& shared) {
  Sums all;
  for (std::size_t s = 0; s < sets.size(); ++s) all.merge(sets[s], shared[s]);
  return all;
}

LineFit line_of(const Sums& sums) {
  LineFit line;
  const double spread = sums.xx - sums.x * sums.x / sums.w;
  line.slope = (sums.xy - sums.x * sums.y / sums.w) / spread;
  line.intercept = (sums.y - line.slope * sums.x) / sums.w;
  line.slope_standard_error = std::sqrt(1.0 / spread);
  line.intercept_standard_error = std::sqrt(sums.xx / (spread * sums.w));
  return line;
}

// A dark variance known perfectly would make it infinite.
double dark_weight(const DarkPoint& dark) {
  const double floor = 1e-6 * std::max(std::abs(dark.variance_dn2), 1e-12);
  return 1.0 / std::pow(std::max(dark.variance_stderr_dn2, floor), 2);
}

// Line through the points plus the dark point, where that holds.
LineFit line_with_dark(const Points& points, double excess_dn4, const DarkPoint& dark) {
  Sums sums = merged(sums_of(points, excess_dn4), points.shared);
  if (!dark.cut_off) sums.add(dark_weight(dark), 0.0, dark.variance_dn2);
  return line_of(sums);
}

// Of the points' distances from that line.
double freedom_of(const Points& points, const DarkPoint& dark) {
  return static_cast<double>(points.size()) - (dark.cut_off ? 2.0 : 1.0);
}

double chi_square(const Points& points, const LineFit& line, double excess_dn4) {
  return merged(sums_of(points, excess_dn4, line), points.shared).yy;
}

// χ² that chance exceeds once in 10,000: a session of 16 channels and several gains has many
// curves, and a straight one must not be called bent.
double chi_square_limit(double freedom) {
  constexpr double kNormalQuantile = 3.7190164854556804;
  return freedom * chi_square_ratio(kNormalQuantile, freedom);
}

// The constant variance that brings χ² down to its expectation.
double mandel_paule(const Points& points, const DarkPoint& dark) {
  const double freedom = freedom_of(points, dark);
  const auto excess_chi = [&](double excess) {
    return chi_square(points, line_with_dark(points, excess, dark), excess) - freedom;
  };
  if (freedom < 1.0 || excess_chi(0.0) + freedom <= chi_square_limit(freedom)) return 0.0;
  double low = 0.0, high = *std::max_element(points.variance.begin(), points.variance.end());
  while (excess_chi(high) > 0.0 && high < 1e30) high *= 4.0;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    (excess_chi(middle) > 0.0 ? low : high) = middle;
  }
  return high;
}

// Weights from the present gain, then Huber's from the residuals of a fit about what their set has
// in common. A line that falls is of no gain, and its cumulants would make errors of negative
// variance: there the noise is that of the dark alone.
void reweight(Points& points, const std::vector<const TransferLevel*>& used, const DarkPoint& dark,
              const LineFit& line, double excess_dn4) {
  const double gain = std::max(line.slope, 0.0);
  std::fill(points.shared.begin(), points.shared.end(), 0.0);
  for (std::size_t i = 0; i < used.size(); ++i) {
    const TransferLevel& level = *used[i];
    points.variance[i] = flat_error_dn4(level, dark, gain) + gain * gain * level.mean_variance_dn2;
    double& shared = points.shared[points.set[i]];
    shared = std::max(
        shared, dark_error_dn4(level, dark, gain) + gain * gain * level.dark_mean_variance_dn2);
  }
  const std::vector<Sums> sets = sums_of(points, excess_dn4, line);
  for (std::size_t i = 0; i < used.size(); ++i) {
    const Sums& set = sets[points.set[i]];
    const double residual = std::abs(points.y[i] - line.intercept - line.slope * points.x[i] -
                                     set.take_out(points.shared[points.set[i]]) * set.y);
    const double deviations = residual / std::sqrt(points.variance[i] + excess_dn4);
    points.huber[i] = deviations > kHuber ? kHuber / deviations : 1.0;
  }
}

// The levels as points of the line; a set of dark frames per dark_set.
Points points_of(const std::vector<const TransferLevel*>& used, const DarkPoint& dark) {
  Points points;
  std::vector<std::pair<int, int>> sets;
  for (const TransferLevel* level : used) {
    points.x.push_back(level->mean_dn);
    points.y.push_back(level->variance_dn2 - level->dark_variance_dn2 + dark.variance_dn2);
    const std::pair<int, int> own{level->dark_frames, level->dark_set};
    const auto found = std::find(sets.begin(), sets.end(), own);
    points.set.push_back(static_cast<std::size_t>(found - sets.begin()));
    if (found == sets.end()) sets.push_back(own);
  }
  points.variance.assign(used.size(), 1.0);
  points.huber.assign(used.size(), 1.0);
  points.shared.assign(sets.size(), 0.0);
  return points;
}

// The line that the dark point does not hold. Minus the dark variance its intercept has the error
// of the dark frames that were subtracted, the common ones' too.
LineFit free_line_of(Points points, const std::vector<const TransferLevel*>& used,
                     const DarkPoint& dark, double excess_dn4) {
  std::vector<bool> counted(points.shared.size(), false);
  for (std::size_t i = 0; i < used.size(); ++i)
    if (const std::size_t s = points.set[i]; used[i]->dark_frames < 2 && !counted[s]) {
      counted[s] = true;
      points.shared[s] += dark.variance_stderr_dn2 * dark.variance_stderr_dn2;
    }
  return line_of(merged(sums_of(points, excess_dn4), points.shared));
}

// The same points with other values y.
Points with_values(Points points, std::vector<double> y) {
  points.y = std::move(y);
  return points;
}

// Slope of the line through c x² per c, at these weights.
double slope_of_parabola(const Points& points, double excess_dn4, const DarkPoint& dark) {
  std::vector<double> square;
  for (const double x : points.x) square.push_back(x * x);
  Sums sums = merged(sums_of(with_values(points, square), excess_dn4), points.shared);
  if (!dark.cut_off) sums.add(dark_weight(dark), 0.0, 0.0);
  return line_of(sums).slope;
}

// What a line leaves of the points, the dark point's last.
std::vector<double> left_of(const std::vector<double>& y, const Points& points, double dark_y,
                            const DarkPoint& dark) {
  Sums sums = merged(sums_of(with_values(points, y), 0.0), points.shared);
  if (!dark.cut_off) sums.add(dark_weight(dark), 0.0, dark_y);
  const LineFit line = line_of(sums);
  std::vector<double> left;
  for (std::size_t i = 0; i < y.size(); ++i)
    left.push_back(y[i] - line.intercept - line.slope * points.x[i]);
  left.push_back(dark_y - line.intercept);
  return left;
}

// c of variance = V0 + K x + c x² by the points' sampling errors alone, 0 unless it is significant.
double parabola_of(Points points, const DarkPoint& dark) {
  constexpr double kDeviations = 3.6;
  constexpr double kFewestFreedom = 3.0;  // a parabola takes one, and two more show what it is
  if (freedom_of(points, dark) < kFewestFreedom) return 0.0;
  std::fill(points.huber.begin(), points.huber.end(), 1.0);
  std::vector<double> square;
  for (const double x : points.x) square.push_back(x * x);
  const std::vector<double> x = left_of(square, points, 0.0, dark);
  const std::vector<double> y = left_of(points.y, points, dark.variance_dn2, dark);
  // Products under the inverse covariance from squares: a b = ((a + b)² - (a - b)²) / 4.
  const auto squared = [&](double of_x, double of_y) {
    std::vector<double> sum;
    for (std::size_t i = 0; i < points.size(); ++i) sum.push_back(of_x * x[i] + of_y * y[i]);
    double total = merged(sums_of(with_values(points, sum), 0.0), points.shared).yy;
    if (!dark.cut_off) total += dark_weight(dark) * std::pow(of_x * x.back() + of_y * y.back(), 2);
    return total;
  };
  const double xx = squared(1, 0), scale = std::sqrt(squared(0, 1) / xx);  // sums of like size
  if (!(scale > 0)) return 0.0;
  const double c = (squared(scale, 1) - squared(scale, -1)) / (4 * scale * xx);
  return std::abs(c) * std::sqrt(xx) > kDeviations ? c : 0.0;
}

// b of a response x = s (1 - b s), whose variance is K (x - 3 b x²): the larger of what means and
// variances show.
double bend_of(double by_means, const Points& points, const DarkPoint& dark, double gain) {
  const double by_variances = parabola_of(points, dark) / (-3.0 * gain);
  return std::abs(by_means) > std::abs(by_variances) ? by_means : by_variances;
}

}  // namespace

double variance_error_dn4(double shot_dn2, int frames, const DarkPoint& dark,
                          double gain_dn_per_e) {
  const double row = std::max(dark.row_variance_dn2, 0.0),
               column = std::max(dark.column_variance_dn2, 0.0);
  const double pixel = std::max(dark.variance_dn2 + shot_dn2 - row - column, 0.0);
  // Of a Poisson variable, in DN⁴, and of the dark noise: cumulants of independent parts add.
  const double fourth_cumulant =
      gain_dn_per_e * gain_dn_per_e * std::max(shot_dn2, 0.0) + dark.fourth_cumulant_dn4;
  const auto pixels = static_cast<double>(dark.pixels);
  const double gaussian =
      (pixel * pixel + 2.0 * (row * pixel + column * pixel + row * column)) / pixels +
      row * row / std::max(dark.row_groups, 1.0) + column * column / std::max(dark.columns, 1.0);
  return 2.0 / (frames - 1.0) * gaussian + fourth_cumulant / (frames * pixels);
}

double flat_error_dn4(const TransferLevel& level, const DarkPoint& dark, double gain_dn_per_e) {
  const double light = gain_dn_per_e * std::max(level.mean_dn, 0.0);
  return variance_error_dn4(light + dark_current_dn2(level, dark), level.frames, dark,
                            gain_dn_per_e) +
         level.rounding_error_dn2 * level.rounding_error_dn2;
}

double dark_error_dn4(const TransferLevel& level, const DarkPoint& dark, double gain_dn_per_e) {
  if (level.dark_frames < 2) return 0.0;
  return variance_error_dn4(dark_current_dn2(level, dark), level.dark_frames, dark, gain_dn_per_e);
}

Estimate<TransferFit> fit_photon_transfer(const std::vector<TransferLevel>& levels,
                                          const DarkPoint& dark) {
  std::vector<const TransferLevel*> used;
  for (const TransferLevel& level : levels)
    if (level.refused.empty()) used.push_back(&level);
  if (used.size() < 2)
    return Undecided{counted(std::ssize(used), "usable light level") +
                     "; 2 are needed, 8 or more are good"};
  Points points = points_of(used, dark);
  double xy = 0.0, xx = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    xy += points.x[i] * (points.y[i] - dark.variance_dn2);
    xx += points.x[i] * points.x[i];
  }
  LineFit line;
  line.slope = std::max(xy / xx, 0.0);
  line.intercept = dark.variance_dn2;
  double excess = 0.0;
  // The first pass only sets the weights: no point is an outlier of a line not yet fitted.
  for (int pass = 0; pass < 12; ++pass) {
    reweight(points, used, dark, line, excess);
    if (pass == 0) std::fill(points.huber.begin(), points.huber.end(), 1.0);
    excess = mandel_paule(points, dark);
    line = line_with_dark(points, excess, dark);
  }
  if (!(line.slope > 0))
    return Undecided{fmt::format("the variance does not rise with the light: slope {:.3g} ± {:.2g}",
                                 line.slope, line.slope_standard_error)};
  TransferFit fit;
  fit.slope_dn_per_e = line.slope;
  const double by_means = response_bend_per_dn(levels);
  fit.exposures_tell_no_light = is_beyond_bends(by_means, levels);
  fit.response_bend_per_dn =
      bend_of(fit.exposures_tell_no_light ? 0.0 : by_means, points, dark, line.slope);
  fit.bend_dn_per_e =
      -3.0 * fit.response_bend_per_dn * line.slope * slope_of_parabola(points, excess, dark);
  fit.slope_stderr = std::hypot(line.slope_standard_error, fit.bend_dn_per_e);
  fit.excess_deviation_dn2 = std::sqrt(excess);
  fit.chi_square_per_level = chi_square(points, line_with_dark(points, 0.0, dark), 0.0) /
                             std::max(freedom_of(points, dark), 1.0);
  const LineFit free_line = free_line_of(points, used, dark, excess);
  fit.intercept_dn2 = free_line.intercept - dark.variance_dn2;
  fit.intercept_stderr_dn2 = free_line.intercept_standard_error;
  for (const TransferLevel& level : levels)
    fit.variance_stderr_dn2.push_back(level.frames < 2
                                          ? std::numeric_limits<double>::quiet_NaN()
                                          : std::sqrt(flat_error_dn4(level, dark, line.slope) +
                                                      dark_error_dn4(level, dark, line.slope)));
  return fit;
}

}  // namespace malus
