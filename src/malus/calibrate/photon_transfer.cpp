#include "malus/calibrate/photon_transfer.h"

#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr double kHuber = 3.0;

struct Points {
  std::vector<double> x, y, variance, huber;
  std::size_t size() const { return x.size(); }
};

// Squared standard error of the temporal variance at a signal, averaged over the channel's pixels.
double variance_error_dn4(double signal, int frames, const DarkPoint& dark, double gain) {
  const double row = std::max(dark.row_variance_dn2, 0.0);
  const double pixel = std::max(dark.variance_dn2 + gain * signal - row, 0.0);
  // Of a Poisson variable, in DN⁴, and of the dark noise: cumulants of independent parts add.
  const double fourth_cumulant = gain * gain * gain * signal + dark.fourth_cumulant_dn4;
  const auto pixels = static_cast<double>(dark.pixels);
  const double gaussian = pixel * pixel / pixels + 2.0 * row * pixel / pixels +
                          row * row / std::max(dark.row_groups, 1);
  return 2.0 / (frames - 1.0) * gaussian + fourth_cumulant / (frames * pixels);
}

double level_error_dn4(const TransferLevel& level, const DarkPoint& dark, double gain) {
  const double dark_error =
      level.dark_frames < 2 ? 0.0 : variance_error_dn4(0.0, level.dark_frames, dark, gain);
  return variance_error_dn4(std::max(level.mean_dn, 0.0), level.frames, dark, gain) + dark_error;
}

// Line through the points plus the dark point at (0, dark_y).
LineFit line_with_dark(const Points& points, double excess_dn4, double dark_y, double dark_stderr) {
  std::vector<double> x{0.0}, y{dark_y}, weights;
  // A dark variance known perfectly would make the weights infinite.
  const double floor = 1e-6 * std::max(std::abs(dark_y), 1e-12);
  weights.push_back(1.0 / std::pow(std::max(dark_stderr, floor), 2));
  for (std::size_t i = 0; i < points.size(); ++i) {
    x.push_back(points.x[i]);
    y.push_back(points.y[i]);
    weights.push_back(points.huber[i] / (points.variance[i] + excess_dn4));
  }
  return fit_line(x, y, weights, true);
}

double chi_square(const Points& points, const LineFit& line, double excess_dn4) {
  double sum = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double r = points.y[i] - line.intercept - line.slope * points.x[i];
    sum += points.huber[i] * r * r / (points.variance[i] + excess_dn4);
  }
  return sum;
}

// χ² that chance exceeds once in 10,000 (Wilson and Hilferty, 1931): a session of 16 channels and
// several gains has many curves, and a straight one must not be called bent.
double chi_square_limit(double freedom) {
  constexpr double kNormalQuantile = 3.7190164854556804;
  const double a = 2.0 / (9.0 * freedom);
  return freedom * std::pow(1.0 - a + kNormalQuantile * std::sqrt(a), 3);
}

// The constant variance that brings χ² down to its expectation.
double mandel_paule(const Points& points, double dark_y, double dark_stderr) {
  const auto freedom = static_cast<double>(points.size()) - 1.0;
  const auto excess_chi = [&](double excess) {
    return chi_square(points, line_with_dark(points, excess, dark_y, dark_stderr), excess) -
           freedom;
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

// Weights from the present gain, then Huber's from the residuals of a fit.
void reweight(Points& points, const std::vector<const TransferLevel*>& used, const DarkPoint& dark,
              const LineFit& line, double excess_dn4) {
  for (std::size_t i = 0; i < used.size(); ++i) {
    points.variance[i] = level_error_dn4(*used[i], dark, line.slope) +
                         line.slope * line.slope * used[i]->mean_variance_dn2;
    const double residual = std::abs(points.y[i] - line.intercept - line.slope * points.x[i]);
    const double deviations = residual / std::sqrt(points.variance[i] + excess_dn4);
    points.huber[i] = deviations > kHuber ? kHuber / deviations : 1.0;
  }
}

}  // namespace

Estimate<TransferFit> fit_photon_transfer(const std::vector<TransferLevel>& levels,
                                          const DarkPoint& dark) {
  std::vector<const TransferLevel*> used;
  for (const TransferLevel& level : levels)
    if (level.refused.empty()) used.push_back(&level);
  if (used.size() < 2)
    return Undecided{fmt::format("{} usable light level{}; 2 are needed, 8 or more are good",
                                 used.size(), used.size() == 1 ? "" : "s")};
  Points points;
  double xy = 0.0, xx = 0.0;
  for (const TransferLevel* level : used) {
    points.x.push_back(level->mean_dn);
    points.y.push_back(level->variance_dn2 - level->dark_variance_dn2 + dark.variance_dn2);
    xy += level->mean_dn * (points.y.back() - dark.variance_dn2);
    xx += level->mean_dn * level->mean_dn;
  }
  points.variance.assign(used.size(), 1.0);
  points.huber.assign(used.size(), 1.0);
  LineFit line;
  line.slope = std::max(xy / xx, 0.0);
  line.intercept = dark.variance_dn2;
  double excess = 0.0;
  // The first pass only sets the weights: no point is an outlier of a line not yet fitted.
  for (int pass = 0; pass < 12; ++pass) {
    reweight(points, used, dark, line, excess);
    if (pass == 0) std::fill(points.huber.begin(), points.huber.end(), 1.0);
    excess = mandel_paule(points, dark.variance_dn2, dark.variance_stderr_dn2);
    line = line_with_dark(points, excess, dark.variance_dn2, dark.variance_stderr_dn2);
  }
  if (!(line.slope > 0))
    return Undecided{fmt::format("the variance does not rise with the light: slope {:.3g} ± {:.2g}",
                                 line.slope, line.slope_standard_error)};
  TransferFit fit;
  fit.slope_dn_per_e = line.slope;
  fit.slope_stderr = line.slope_standard_error;
  fit.excess_deviation_dn2 = std::sqrt(excess);
  fit.chi_square_per_level =
      chi_square(points, line_with_dark(points, 0.0, dark.variance_dn2, dark.variance_stderr_dn2),
                 0.0) /
      std::max(static_cast<double>(points.size()) - 1.0, 1.0);
  std::vector<double> weights;
  for (std::size_t i = 0; i < points.size(); ++i)
    weights.push_back(points.huber[i] / (points.variance[i] + excess));
  const LineFit free_line = fit_line(points.x, points.y, weights, true);
  fit.intercept_dn2 = free_line.intercept - dark.variance_dn2;
  fit.intercept_stderr_dn2 =
      std::hypot(free_line.intercept_standard_error, dark.variance_stderr_dn2);
  for (const TransferLevel& level : levels)
    fit.variance_stderr_dn2.push_back(level.frames < 2
                                          ? std::numeric_limits<double>::quiet_NaN()
                                          : std::sqrt(level_error_dn4(level, dark, line.slope)));
  return fit;
}

}  // namespace malus
