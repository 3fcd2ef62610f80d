#include "malus/noise/distribution.h"

#include "malus/base/error.h"
#include "malus/base/log_gamma.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

namespace malus {
namespace {

// P(T > x) for scale 1 without loss in the upper tail.
double tukey_upper_tail(double x, double lambda) { return tukey_lambda_cdf(-x, lambda); }

double power_ratio(double lambda, double a) {
  return std::abs(lambda) < 1e-12 ? a : std::expm1(lambda * a) / lambda;
}

// Integral of P(T > y) over y from x to infinity, scale 1.
double integrated_tail(double x, double lambda) {
  if (x < 0) return integrated_tail(-x, lambda) - x;  // symmetry about 0
  const double p = tukey_upper_tail(x, lambda);
  if (p <= 0) return 0.0;
  const double partial =
      -((1.0 - p) * power_ratio(lambda, std::log1p(-p)) + p * power_ratio(lambda, std::log(p))) /
      (lambda + 1.0);
  return partial - x * p;
}

// Gauss-Legendre on [-1, 1].
constexpr std::array<double, 4> kGaussX{-0.8611363115940526, -0.3399810435848563,
                                        0.3399810435848563, 0.8611363115940526};
constexpr std::array<double, 4> kGaussW{0.3478548451374538, 0.6521451548625461, 0.6521451548625461,
                                        0.3478548451374538};

// Bisection: about 60 halvings reach the last bits.
double invert(const std::function<double(double)>& rising, double low, double high, double target) {
  for (int i = 0; i < 200 && high - low > 1e-13 * (1.0 + std::abs(low)); ++i) {
    const double middle = 0.5 * (low + high);
    (rising(middle) < target ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace

ReadDistribution::ReadDistribution(double lambda, double scale_dn, double quantization_dn)
    : lambda_(lambda), scale_(scale_dn), half_step_(0.5 * quantization_dn) {
  MALUS_REQUIRE(lambda > -0.5 && scale_dn >= 0 && quantization_dn >= 0);
  // u = 1/(1+exp(-y)): the trapezoidal rule in y converges exponentially for Tukey-lambda.
  std::vector<Node> read{{0.0, 1.0}};
  if (scale_ > 0) {
    read.clear();
    constexpr double kStep = 0.75, kEnd = 48.0;
    for (double y = -kEnd; y <= kEnd; y += kStep) {
      const double u = 1.0 / (1.0 + std::exp(-std::abs(y)));  // upper half
      const double lower = 1.0 / (1.0 + std::exp(std::abs(y)));
      const double x = -scale_ * tukey_lambda_quantile(lower, lambda_);
      read.push_back({y < 0 ? -x : x, kStep * u * lower});
    }
  }
  for (const Node& node : read) {
    if (half_step_ == 0) {
      nodes_.push_back(node);
      continue;
    }
    for (std::size_t i = 0; i < kGaussX.size(); ++i)
      nodes_.push_back({node.x_dn + half_step_ * kGaussX[i], 0.5 * node.weight * kGaussW[i]});
  }
  double total = 0;
  for (const Node& node : nodes_) total += node.weight;
  for (Node& node : nodes_) node.weight /= total;
}

double ReadDistribution::upper_tail(double x_dn) const {
  if (scale_ == 0) {
    if (half_step_ == 0) return x_dn < 0 ? 1.0 : 0.0;
    return std::clamp(0.5 - 0.5 * x_dn / half_step_, 0.0, 1.0);
  }
  const double x = x_dn / scale_, h = half_step_ / scale_;
  if (h == 0) return tukey_upper_tail(x, lambda_);
  if (h < 0.05) {  // the closed form would cancel; the integrand is smooth
    double sum = 0;
    for (std::size_t i = 0; i < kGaussX.size(); ++i)
      sum += 0.5 * kGaussW[i] * tukey_upper_tail(x + h * kGaussX[i], lambda_);
    return sum;
  }
  return (integrated_tail(x - h, lambda_) - integrated_tail(x + h, lambda_)) / (2.0 * h);
}

double ReadDistribution::quantile(double u) const {
  MALUS_REQUIRE(u > 0 && u < 1);
  if (u > 0.5) return -quantile(1.0 - u);
  if (scale_ == 0) return half_step_ * (2.0 * u - 1.0);
  const double centre = scale_ * tukey_lambda_quantile(u, lambda_);
  return invert([this](double x) { return cdf(x); }, centre - 2.0 * half_step_ - 1e-12,
                std::max(centre + 2.0 * half_step_, 0.0) + 1e-12, u);
}

double ReadDistribution::variance_dn2() const {
  return scale_ * scale_ * tukey_lambda_variance(lambda_) + half_step_ * half_step_ / 3.0;
}

PixelDistribution::PixelDistribution(const PhysicsChannel& channel, const PhysicsParts& parts,
                                     double quantization_dn, double signal_dn)
    : read_(channel.lambda, parts.read ? channel.sigma_tl_dn : 0.0,
            parts.quantization ? quantization_dn : 0.0) {
  const double K = channel.gain_dn_per_e, offset = parts.bias ? channel.mu_dn : 0.0;
  mean_ = signal_dn + offset;
  variance_ = read_.variance_dn2();
  if (!(parts.shot && signal_dn > 0)) {
    level_dn_ = {signal_dn + offset};
    probability_ = {1.0};
    return;
  }
  const double m = signal_dn / K;
  variance_ += K * signal_dn;
  // Beyond 8 sd and 45 counts lies less than 1e-14.
  const double reach = 8.0 * std::sqrt(m) + 45.0;
  const double first = std::max(0.0, std::floor(m - reach)), last = std::ceil(m + reach);
  for (double n = first; n <= last; n += 1.0) {
    const double p = std::exp(n * std::log(m) - m - log_gamma(n + 1.0));
    if (p < 1e-18) continue;
    level_dn_.push_back(K * n + offset);
    probability_.push_back(p);
  }
}

double PixelDistribution::upper_tail(double x_dn) const {
  double sum = 0;
  for (std::size_t i = 0; i < level_dn_.size(); ++i)
    sum += probability_[i] * read_.upper_tail(x_dn - level_dn_[i]);
  return sum;
}

double PixelDistribution::cdf(double x_dn) const {
  double sum = 0;
  for (std::size_t i = 0; i < level_dn_.size(); ++i)
    sum += probability_[i] * read_.cdf(x_dn - level_dn_[i]);
  return sum;
}

double PixelDistribution::quantile(double u) const {
  MALUS_REQUIRE(u > 0 && u < 1);
  const double sd = std::sqrt(variance_) + 1e-12;
  double low = mean_ - sd, high = mean_ + sd;
  while (cdf(low) > u) low -= 2.0 * (mean_ - low);
  if (u > 0.5) {
    while (upper_tail(high) > 1.0 - u) high += 2.0 * (high - mean_);
    return invert([this](double x) { return -upper_tail(x); }, low, high, u - 1.0);
  }
  while (cdf(high) < u) high += 2.0 * (high - mean_);
  return invert([this](double x) { return cdf(x); }, low, high, u);
}

}  // namespace malus
