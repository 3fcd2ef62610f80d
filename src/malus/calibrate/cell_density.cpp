#include "malus/calibrate/internal/cell_density.h"

#include "malus/base/index.h"
#include "malus/base/normal_distribution.h"
#include "malus/base/normal_nodes.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

// Relative to one over the residuals' deviation: a density below it counts for little.
constexpr double kDensityFloor = 3e-5;

// Near its end, at scale/λ, the density falls as the distance to the power of 1/λ - 1: from here on
// ever more abruptly, and at λ = 1 it jumps.
constexpr double kAbruptLambda = 0.35;

// Lower half of the Tukey-lambda distribution function of scale 1, tabulated at rising quantiles.
class LowerHalf {
 public:
  explicit LowerHalf(double lambda) {
    constexpr int kKnots = 420;
    constexpr double kStep = 0.1;  // in log-odds: F changes by at most 10 % between knots
    for (int k = kKnots; k >= 0; --k) {
      const double u = 1.0 / (1.0 + std::exp(kStep * k));
      const double x = tukey_lambda_quantile(u, lambda);
      if (!x_.empty() && !(x > x_.back())) continue;  // bounded support: knots fall together
      x_.push_back(x);
      f_.push_back(u);
      slope_.push_back(1.0 / (std::pow(u, lambda - 1.0) + std::pow(1.0 - u, lambda - 1.0)));
    }
  }
  /// Probability below x; hint makes a rising or falling sequence of x cheap.
  double operator()(double x, std::size_t& hint) const {
    if (x > 0) return 1.0 - lower(-x, hint);
    return lower(x, hint);
  }

 private:
  double lower(double x, std::size_t& k) const {
    if (x <= x_.front()) return 0.0;
    k = std::min(k, x_.size() - 2);
    while (k > 0 && x < x_[k]) --k;
    while (k + 2 < x_.size() && x > x_[k + 1]) ++k;
    // Cubic Hermite; the slopes are exact, the error is below 1e-6 of F.
    const double width = x_[k + 1] - x_[k], t = (x - x_[k]) / width;
    const double value = f_[k] * (1 + 2 * t) * (1 - t) * (1 - t) + f_[k + 1] * t * t * (3 - 2 * t) +
                         width * t * (1 - t) * (slope_[k] * (1 - t) - slope_[k + 1] * t);
    return std::clamp(value, f_[k], f_[k + 1]);
  }
  std::vector<double> x_, f_, slope_;
};

// Integral of the distribution function of normal noise from -∞ to s.
double normal_ramp(double s, double deviation) {
  if (!(deviation > 0)) return std::max(s, 0.0);
  return deviation * mean_above_zero(s / deviation);
}

}  // namespace

CellDensity::CellDensity(const ResidualHistogram& histogram, const ResidualBlur& blur)
    : deviation_dn_(std::sqrt(blur.offset_variance_dn2)),
      // A cell is a box too: to second order its width adds to the step's in squares.
      half_step_dn_(0.5 * std::hypot(blur.quantization_dn, histogram.cell_dn())) {
  for (const auto& cell : histogram.cells()) centre_.push_back(histogram.centre_dn(cell));
  const double rms = std::sqrt(histogram.mean_square_dn2());
  floor_ = kDensityFloor * 2.0 * half_step_dn_ / rms;
  lay_nodes(rms);
  lay_kernel(blur, histogram.cell_dn());
}

std::vector<double> CellDensity::log_density(double lambda, double log_scale) const {
  const std::vector<double> over = probability(node_, lambda, log_scale);
  double integral = 0.0;
  for (std::size_t i = 0; i < over.size(); ++i)
    integral += node_width_[i] * std::log1p(over[i] / floor_);
  const double common = floor_ / half_step_dn_ * integral;  // both sides: q is two half steps
  std::vector<double> density = probability(centre_, lambda, log_scale);
  for (double& d : density) d = std::log(d + floor_) + common;
  return density;
}

// Where the integral is summed (trapezoids): evenly out to eight deviations, then wider.
void CellDensity::lay_nodes(double rms_dn) {
  constexpr double kPerDeviation = 24.0, kEven = 8.0, kFarthest = 1000.0, kGrowth = 1.05;
  double width = rms_dn / kPerDeviation;
  for (double x = 0.0; x < kFarthest * rms_dn; x += width) {
    node_.push_back(x);
    if (x > kEven * rms_dn) width *= kGrowth;
  }
  for (std::size_t i = 0; i < node_.size(); ++i)
    node_width_.push_back(0.5 *
                          (node_[std::min(i + 1, node_.size() - 1)] - node_[i > 0 ? i - 1 : 0]));
}

// Step, cell and normal offset error after each other, without an approximation: a second
// difference of normal_ramp. Its integral over both sides is that of the smooth law's box.
void CellDensity::lay_kernel(const ResidualBlur& blur, double cell_dn) {
  constexpr int kKnots = 800;
  constexpr double kDeviations = 6.0;
  const bool stepped = blur.quantization_dn > 0;
  const double q = stepped ? blur.quantization_dn : cell_dn;
  const double h = cell_dn * (stepped ? 1.0 : 1e-3);  // without a step the cell is the box
  kernel_step_dn_ = (0.5 * (q + h) + kDeviations * deviation_dn_) / (kKnots - 1);
  const auto ramp = [&](double s) { return normal_ramp(s, deviation_dn_); };
  const auto kernel = [&](double t) {
    return (ramp(t + 0.5 * (q + h)) - ramp(t + 0.5 * (q - h)) - ramp(t - 0.5 * (q - h)) +
            ramp(t - 0.5 * (q + h))) /
           h;
  };
  within_.push_back(0.0);
  for (int k = 1; k < kKnots; ++k)
    within_.push_back(within_.back() + kernel_step_dn_ * kernel((k - 0.5) * kernel_step_dn_));
  const double all = within_.back();
  for (double& sum : within_) sum *= half_step_dn_ / all;
}

std::vector<double> CellDensity::probability(const std::vector<double>& distance_dn, double lambda,
                                             double log_scale) const {
  return lambda > kAbruptLambda ? of_bounded_law(distance_dn, lambda, log_scale)
                                : of_smooth_law(distance_dn, lambda, log_scale);
}

// A few points stand for the normal offset error, which a smooth density allows.
std::vector<double> CellDensity::of_smooth_law(const std::vector<double>& distance_dn,
                                               double lambda, double log_scale) const {
  const LowerHalf cdf(lambda);
  const double inverse_scale = std::exp(-log_scale);
  std::vector<double> density(distance_dn.size(), 0.0);
  for (const NormalNode& node : kNormalNodes) {
    const double shift = deviation_dn_ * node.at;
    std::size_t upper_hint = 0, lower_hint = 0;
    for (std::size_t i = distance_dn.size(); i-- > 0;) {
      const double x = shift - distance_dn[i];  // the lower side, where small values are exact
      density[i] += node.weight * (cdf((x + half_step_dn_) * inverse_scale, upper_hint) -
                                   cdf((x - half_step_dn_) * inverse_scale, lower_hint));
    }
  }
  return density;
}

// Of an abrupt end those points, and a cell of no width, would make a staircase whose steps λ
// follows (λ of 0.8 came out as 0.79, 1.5 stated errors below). So the law is divided into narrow
// pieces of even density, the last of which ends where it does, and each is widened by the kernel.
std::vector<double> CellDensity::of_bounded_law(const std::vector<double>& distance_dn,
                                                double lambda, double log_scale) const {
  constexpr int kPieces = 480;  // of both sides
  const LowerHalf cdf(lambda);
  const double end = 1.0 / lambda, width = 2.0 * end / kPieces, scale_dn = std::exp(log_scale);
  std::vector<double> piece(kPieces);  // density, per DN
  std::size_t hint = 0;
  for (int k = 0; k < kPieces / 2; ++k) {
    const double below = k * width - end, mass = cdf(below + width, hint) - cdf(below, hint);
    piece[as_index(k)] = piece[as_index(kPieces - 1 - k)] = mass / (width * scale_dn);
  }
  const double reach_dn = kernel_step_dn_ * static_cast<double>(within_.size() - 1);
  const auto place = [&](double dn) { return (dn / scale_dn + end) / width; };  // in pieces
  const auto at = [&](int k) { return (k * width - end) * scale_dn; };
  std::vector<double> density(distance_dn.size(), 0.0);
  for (std::size_t i = 0; i < density.size(); ++i) {
    const double x = distance_dn[i];
    const int first = std::max(static_cast<int>(std::floor(place(x - reach_dn))), 0);
    const double last = std::min(place(x + reach_dn), 1.0 * kPieces);
    double below = kernel_within(at(first) - x);
    for (int k = first; k < last; ++k) {
      const double above = kernel_within(at(k + 1) - x);
      density[i] += piece[as_index(k)] * (above - below);
      below = above;
    }
  }
  return density;
}

double CellDensity::kernel_within(double distance_dn) const {
  const double knots = std::abs(distance_dn) / kernel_step_dn_;
  if (!(knots < static_cast<double>(within_.size() - 1)))
    return std::copysign(within_.back(), distance_dn);
  const auto knot = static_cast<std::size_t>(knots);
  const double part = knots - static_cast<double>(knot);
  return std::copysign(within_[knot] + part * (within_[knot + 1] - within_[knot]), distance_dn);
}

}  // namespace malus
