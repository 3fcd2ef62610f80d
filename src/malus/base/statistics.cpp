#include "malus/base/statistics.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace malus {

void Moments::add(double x) {
  Moments one;
  one.count_ = 1;
  one.mean_ = x;
  merge(one);
}

void Moments::merge(const Moments& o) {
  if (o.count_ == 0) return;
  if (count_ == 0) {
    *this = o;
    return;
  }
  const auto na = static_cast<double>(count_), nb = static_cast<double>(o.count_), n = na + nb;
  const double d = o.mean_ - mean_, d2 = d * d;
  const double m2 = m2_ + o.m2_ + d2 * na * nb / n;
  const double m3 =
      m3_ + o.m3_ + d * d2 * na * nb * (na - nb) / (n * n) + 3 * d * (na * o.m2_ - nb * m2_) / n;
  const double m4 = m4_ + o.m4_ + d2 * d2 * na * nb * (na * na - na * nb + nb * nb) / (n * n * n) +
                    6 * d2 * (na * na * o.m2_ + nb * nb * m2_) / (n * n) +
                    4 * d * (na * o.m3_ - nb * m3_) / n;
  mean_ += d * nb / n;
  m2_ = m2;
  m3_ = m3;
  m4_ = m4;
  count_ += o.count_;
}

double Moments::variance() const {
  if (count_ < 2) return std::numeric_limits<double>::quiet_NaN();
  return m2_ / static_cast<double>(count_ - 1);
}

double Moments::variance_standard_error() const {
  const auto n = static_cast<double>(count_);
  if (count_ < 4) return std::numeric_limits<double>::quiet_NaN();
  const double variance_ = variance();
  return std::sqrt(std::max(0.0, m4_ / n - variance_ * variance_ * (n - 3) / (n - 1)) / n);
}

double root_standard_error(double square, double error) {
  const double positive = std::max(square, 0.0);
  return error / (std::sqrt(positive) + std::sqrt(positive + error));
}

double mean_of(std::span<const double> values) {
  Moments m;
  for (double v : values) m.add(v);
  return m.count() ? m.mean() : std::numeric_limits<double>::quiet_NaN();
}

double standard_deviation_of(std::span<const double> values) {
  Moments m;
  for (double v : values) m.add(v);
  return std::sqrt(m.variance());
}

double median_of(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

double robust_deviation_of(const std::vector<double>& values) {
  const double centre = median_of(values);
  std::vector<double> distance;
  distance.reserve(values.size());
  for (double v : values) distance.push_back(std::abs(v - centre));
  return median_of(std::move(distance)) / kMedianOfNormal;
}

LineFit fit_line(std::span<const double> x, std::span<const double> y,
                 std::span<const double> weights, bool known_variances) {
  MALUS_REQUIRE(x.size() == y.size() && x.size() >= 2);
  MALUS_REQUIRE(weights.empty() || weights.size() == x.size());
  const auto weight = [&](std::size_t i) { return weights.empty() ? 1.0 : weights[i]; };
  double sw = 0, sx = 0, sy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    sw += weight(i);
    sx += weight(i) * x[i];
    sy += weight(i) * y[i];
  }
  const double mx = sx / sw, my = sy / sw;
  double sxx = 0, sxy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    sxx += weight(i) * (x[i] - mx) * (x[i] - mx);
    sxy += weight(i) * (x[i] - mx) * (y[i] - my);
  }
  MALUS_REQUIRE(sxx > 0);
  LineFit fit;
  fit.slope = sxy / sxx;
  fit.intercept = my - fit.slope * mx;
  double rss = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double r = y[i] - fit.intercept - fit.slope * x[i];
    rss += weight(i) * r * r;
  }
  const auto n = static_cast<double>(x.size());
  const double scale = x.size() > 2 ? rss / (n - 2) : 0.0;
  fit.residual_deviation = std::sqrt(scale * n / sw);
  const double unit = known_variances ? 1.0 : scale;
  fit.slope_standard_error = std::sqrt(unit / sxx);
  fit.intercept_standard_error = std::sqrt(unit * (1.0 / sw + mx * mx / sxx));
  return fit;
}

}  // namespace malus
