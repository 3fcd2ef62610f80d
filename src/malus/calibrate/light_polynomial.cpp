#include "malus/calibrate/internal/light_polynomial.h"

#include "malus/base/index.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace malus {
namespace {

constexpr int kLowDegree = 4, kHighDegree = 12;

// Polynomials of degree 0, 1, ... that are orthonormal over 0 ... length - 1: [degree][at].
std::vector<std::vector<double>> orthonormal_polynomials(int length, int degree) {
  std::vector<std::vector<double>> basis;
  for (int d = 0; d <= degree; ++d) {
    std::vector<double> next(as_index(length));
    for (int i = 0; i < length; ++i)
      next[as_index(i)] = std::pow(2.0 * i / std::max(length - 1, 1) - 1.0, d);
    const auto product = [&](const std::vector<double>& other) {
      return std::inner_product(next.begin(), next.end(), other.begin(), 0.0);
    };
    for (const std::vector<double>& lower : basis) {
      const double part = product(lower);
      for (std::size_t i = 0; i < next.size(); ++i) next[i] -= part * lower[i];
    }
    const double norm = std::sqrt(product(next));
    for (double& value : next) value /= norm;
    basis.push_back(std::move(next));
  }
  return basis;
}

// Least square of a term that stands out of lines (rows, or columns) which differ by more than the
// pixels' noise explains, 0 where they do not. rest: sum of squares that their terms leave; noise:
// of one pixel. Few lines tell their variance badly.
double least_of_lines(double rest, std::size_t lines, std::size_t terms, double of_noise,
                      double noise) {
  constexpr double kDeviations = 3.0, kFewLines = 8.0;
  const auto freedom = static_cast<double>(std::max(lines, terms + 1) - terms);
  if (!(rest > noise * (freedom + kDeviations * std::sqrt(2.0 * freedom)))) return 0;
  return of_noise * (1.0 + kFewLines / freedom) * rest / freedom;
}

// Leaves such terms only. of_row, of_col: the lines' sums by the lowest polynomial of the other
// direction, which terms of one direction alone share; all: sum of the pixels' squares.
void keep_outstanding(const std::vector<double>& of_row, const std::vector<double>& of_col,
                      double all, LightPolynomial& light) {
  constexpr double kOfNoise = 16.0;
  const auto squares = [](const std::vector<double>& values) {
    return std::inner_product(values.begin(), values.end(), values.begin(), 0.0);
  };
  const std::size_t pixels = of_row.size() * of_col.size(), terms = light.coefficients.size();
  const double noise = std::max(all - squares(light.coefficients), 0.0) /
                       static_cast<double>(std::max(pixels, terms + 1) - terms);
  double in_rows = squares(of_row), in_cols = squares(of_col);
  for (std::size_t i = 0; i < light.down.size(); ++i) in_rows -= std::pow(light.term(i, 0), 2);
  for (std::size_t j = 0; j < light.right.size(); ++j) in_cols -= std::pow(light.term(0, j), 2);
  const double of_rows = least_of_lines(in_rows, of_row.size(), light.down.size(), kOfNoise, noise),
               of_cols =
                   least_of_lines(in_cols, of_col.size(), light.right.size(), kOfNoise, noise);
  for (std::size_t i = 0; i < light.down.size(); ++i)
    for (std::size_t j = 0; j < light.right.size(); ++j) {
      double& own = light.term(i, j);
      const double least =
          std::max({kOfNoise * noise, j == 0 ? of_rows : 0.0, i == 0 ? of_cols : 0.0});
      if (!light.low(i, j) && own * own < least) own = 0;
    }
}

}  // namespace

// Which terms a channel's light is always taken for: vignetting, a lamp to one side. Where light
// curves, a window's mean is not the light in its middle, least so across a narrow plane: there,
// too, it may curve, so the degree falls no sooner than lines are missing.
bool LightPolynomial::low(std::size_t i, std::size_t j) const {
  constexpr std::size_t kLinesPerDegree = 2;
  return i + j <= kLowDegree && i <= down[0].size() / kLinesPerDegree &&
         j <= right[0].size() / kLinesPerDegree;
}

bool LightPolynomial::has_high() const {
  for (std::size_t k = 0; k < coefficients.size(); ++k)
    if (coefficients[k] != 0 && !low(k / right.size(), k % right.size())) return true;
  return false;
}

LightPolynomial fit_light(const MosaicGeometry& geometry, int channel, LightDegree degree,
                          Image& light) {
  const bool high = degree == LightDegree::kHigh;
  const int rows = geometry.channel_rows(channel), cols = geometry.channel_cols(channel);
  const auto polynomials = [high](int length) {
    return orthonormal_polynomials(
        length, high ? std::min(3 * length / 4, kHighDegree) : std::min(length / 2, kLowDegree));
  };
  LightPolynomial out{polynomials(rows), polynomials(cols), {}};
  const std::size_t n = out.right.size();
  out.coefficients.assign(out.down.size() * n, 0.0);
  std::vector<double> of_row(as_index(rows) * n, 0.0), of_col(as_index(cols), 0.0);
  double all = 0;
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    const double own = light(row, col);
    all += own * own;
    of_col[as_index(c)] += own * out.down[0][as_index(r)];
    for (std::size_t j = 0; j < n; ++j)
      of_row[as_index(r) * n + j] += own * out.right[j][as_index(c)];
  });
  for (int r = 0; r < rows; ++r)
    for (std::size_t i = 0; i < out.down.size(); ++i)
      for (std::size_t j = 0; j < n; ++j)
        if (high ? i + j <= kHighDegree : out.low(i, j))
          out.term(i, j) += of_row[as_index(r) * n + j] * out.down[i][as_index(r)];
  if (high) {
    std::vector<double> of_rows;
    for (int r = 0; r < rows; ++r) of_rows.push_back(of_row[as_index(r) * n]);
    keep_outstanding(of_rows, of_col, all, out);
  }
  std::fill(of_row.begin(), of_row.end(), 0.0);
  for (int r = 0; r < rows; ++r)
    for (std::size_t i = 0; i < out.down.size(); ++i)
      for (std::size_t j = 0; j < n; ++j)
        of_row[as_index(r) * n + j] += out.term(i, j) * out.down[i][as_index(r)];
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    double sum = 0;
    for (std::size_t j = 0; j < n; ++j)
      sum += of_row[as_index(r) * n + j] * out.right[j][as_index(c)];
    light(row, col) = static_cast<float>(sum);
  });
  return out;
}

}  // namespace malus
