// A channel's light as a polynomial of the place.
#pragma once

#include "malus/base/index.h"
#include "malus/calibrate/geometry.h"
#include "malus/image/view.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

namespace malus {

// Polynomials of degree 0, 1, ... that are orthonormal over 0 ... length - 1: [degree][at].
inline std::vector<std::vector<double>> orthonormal_polynomials(int length, int degree) {
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

// A channel's light as a polynomial of the place, of degree 4 in all: vignetting, a lamp to one
// side. Where light curves, a window's mean is not the light in its middle, least so across a
// narrow plane: there, too, it may curve, so the degree falls no sooner than lines are missing.
// Fitted by least squares; value(row, col) of the mosaic.
template <class Value>
void fit_light(const MosaicGeometry& geometry, int channel, const Value& value, Image& light) {
  constexpr int kDegree = 4, kLinesPerDegree = 2;
  const int rows = geometry.channel_rows(channel), cols = geometry.channel_cols(channel);
  const auto polynomials = [=](int length) {
    return orthonormal_polynomials(length, std::min(length / kLinesPerDegree, kDegree));
  };
  const auto down = polynomials(rows), right = polynomials(cols);
  const std::size_t n = right.size();
  const auto counts = [](std::size_t i, std::size_t j) { return i + j <= kDegree; };
  std::vector<double> coefficients(down.size() * n, 0.0);  // [down][right]
  std::vector<double> of_row(as_index(rows) * n, 0.0);
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    for (std::size_t j = 0; j < n; ++j)
      of_row[as_index(r) * n + j] += double{value(row, col)} * right[j][as_index(c)];
  });
  for (int r = 0; r < rows; ++r)
    for (std::size_t i = 0; i < down.size(); ++i)
      for (std::size_t j = 0; j < n; ++j)
        if (counts(i, j))
          coefficients[i * n + j] += of_row[as_index(r) * n + j] * down[i][as_index(r)];
  std::fill(of_row.begin(), of_row.end(), 0.0);
  for (int r = 0; r < rows; ++r)
    for (std::size_t i = 0; i < down.size(); ++i)
      for (std::size_t j = 0; j < n; ++j)
        of_row[as_index(r) * n + j] += coefficients[i * n + j] * down[i][as_index(r)];
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    double sum = 0;
    for (std::size_t j = 0; j < n; ++j) sum += of_row[as_index(r) * n + j] * right[j][as_index(c)];
    light(row, col) = static_cast<float>(sum);
  });
}

}  // namespace malus
