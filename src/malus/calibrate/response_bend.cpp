#include "malus/calibrate/internal/response_bend.h"

#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace malus {
namespace {

constexpr std::size_t kFewestExposures = 5;
constexpr double kBendChance = 3e-4, kLeastBend = 1e-3;
// Of the brightest level. Below, errors of the mean are taken for absolute (black), above for
// relative ones (lamp).
constexpr double kDimShare = 0.05;

struct Exposed {
  std::vector<double> exposure, signal, weight;
};

Exposed exposed_levels(const std::vector<TransferLevel>& levels) {
  Exposed out;
  for (const TransferLevel& level : levels)
    if (level.refused.empty() && level.exposure_s > 0) {
      out.exposure.push_back(level.exposure_s);
      out.signal.push_back(level.mean_dn);
    }
  if (out.signal.empty()) return out;
  const double brightest = *std::max_element(out.signal.begin(), out.signal.end());
  for (const double signal : out.signal)
    out.weight.push_back(1.0 / (std::pow(signal / brightest, 2) + kDimShare * kDimShare));
  return out;
}

std::size_t distinct(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return static_cast<std::size_t>(std::unique(values.begin(), values.end()) - values.begin());
}

}  // namespace

double student_chance(double t, int freedom) {
  const double angle = std::atan(t / std::sqrt(static_cast<double>(freedom)));
  const double square = std::pow(std::cos(angle), 2);
  const bool odd = freedom % 2 == 1;
  double term = odd ? std::cos(angle) : 1.0, sum = 0.0;
  for (int k = odd ? 1 : 0; k <= freedom - 2; k += 2) {
    sum += term;
    term *= square * (k + 1.0) / (k + 2.0);
  }
  const double inside =
      odd ? 2.0 / std::numbers::pi * (angle + std::sin(angle) * sum) : std::sin(angle) * sum;
  return std::max(1.0 - inside, 0.0);
}

double response_bend_per_dn(const std::vector<TransferLevel>& levels) {
  const Exposed points = exposed_levels(levels);
  const std::size_t n = points.signal.size();
  if (n < kFewestExposures || distinct(points.exposure) < kFewestExposures) return 0.0;
  // The parabola's bend is the slope of what two lines leave of signal and squared exposure.
  std::vector<double> square;
  for (const double t : points.exposure) square.push_back(t * t);
  const LineFit line = fit_line(points.exposure, points.signal, points.weight);
  const LineFit of_square = fit_line(points.exposure, square, points.weight);
  double xx = 0.0, xy = 0.0, yy = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const double t = points.exposure[i];
    const double x = square[i] - of_square.intercept - of_square.slope * t;
    const double y = points.signal[i] - line.intercept - line.slope * t;
    xx += points.weight[i] * x * x;
    xy += points.weight[i] * x * y;
    yy += points.weight[i] * y * y;
  }
  const double bend = xy / xx, slope = line.slope - bend * of_square.slope;
  const double b = slope > 0 ? -bend / (slope * slope)
                             : std::copysign(std::numeric_limits<double>::infinity(), -bend);
  const double brightest = *std::max_element(points.signal.begin(), points.signal.end());
  if (!(std::abs(b) * brightest > kLeastBend)) return 0.0;
  const auto freedom = static_cast<int>(n) - 3;
  const double scatter = std::max(yy - bend * xy, 0.0) / freedom;
  if (scatter > 0 &&
      student_chance(std::abs(bend) * std::sqrt(xx / scatter), freedom) > kBendChance)
    return 0.0;
  return b;
}

bool is_beyond_bends(double bend_per_dn, const std::vector<TransferLevel>& levels) {
  constexpr double kMostBend = 0.25;
  double brightest = 0.0;
  for (const TransferLevel& level : levels)
    if (level.refused.empty()) brightest = std::max(brightest, level.mean_dn);
  return std::abs(bend_per_dn) * brightest > kMostBend;
}

}  // namespace malus
