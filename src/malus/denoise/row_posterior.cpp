#include "malus/denoise/row_posterior.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

// The lower half of a symmetric matrix that holds nothing further than `width` from its diagonal.
class Band {
 public:
  Band(int size, int width)
      : size_(size),
        width_(width),
        values_(static_cast<std::size_t>(size) * (static_cast<std::size_t>(width) + 1)) {}
  int size() const { return size_; }
  int width() const { return width_; }
  int last(int col) const { return std::min(size_ - 1, col + width_); }  ///< row of the column
  double& operator()(int row, int col) { return values_[index(row, col)]; }
  double operator()(int row, int col) const { return values_[index(row, col)]; }

 private:
  std::size_t index(int row, int col) const {
    return static_cast<std::size_t>(std::max(row, col)) * (static_cast<std::size_t>(width_) + 1) +
           static_cast<std::size_t>(std::abs(row - col));
  }
  int size_, width_;
  std::vector<double> values_;
};

int width_of(const std::vector<RowEvidence>& evidence) {
  int width = 0;
  for (const RowEvidence& e : evidence) {
    const auto [low, high] = std::minmax({e.group, e.above, e.below});
    width = std::max(width, high - low);
  }
  return width;
}

// L D Lᵀ in place; L's diagonal is one, D takes its place.
void factorize(Band& matrix) {
  for (int col = 0; col < matrix.size(); ++col)
    for (int row = col; row <= matrix.last(col); ++row) {
      double value = matrix(row, col);
      for (int k = std::max(0, row - matrix.width()); k < col; ++k)
        value -= matrix(row, k) * matrix(col, k) * matrix(k, k);
      matrix(row, col) = row == col ? value : value / matrix(col, col);
    }
}

void solve(const Band& factors, std::vector<double>& values) {
  const auto at = [&](int i) -> double& { return values[static_cast<std::size_t>(i)]; };
  for (int col = 0; col < factors.size(); ++col)
    for (int row = col + 1; row <= factors.last(col); ++row) at(row) -= factors(row, col) * at(col);
  for (int col = factors.size() - 1; col >= 0; --col) {
    at(col) /= factors(col, col);
    for (int row = col + 1; row <= factors.last(col); ++row) at(col) -= factors(row, col) * at(row);
  }
}

// The inverse inside the band, from its end to its beginning, which needs nothing outside of it
// (Takahashi, Fagan, Chin, 8th PICA conference, 1973).
Band inverse_in_band(const Band& factors) {
  Band inverse(factors.size(), factors.width());
  for (int col = factors.size() - 1; col >= 0; --col)
    for (int row = factors.last(col); row >= col; --row) {
      double value = row == col ? 1.0 / factors(col, col) : 0.0;
      for (int k = col + 1; k <= factors.last(col); ++k) value -= inverse(row, k) * factors(k, col);
      inverse(row, col) = value;
    }
  return inverse;
}

}  // namespace

RowNoise row_posterior(const std::vector<RowEvidence>& evidence,
                       const std::vector<double>& variance, int groups) {
  MALUS_REQUIRE(evidence.size() == variance.size());
  Band precision(groups, width_of(evidence));
  RowNoise rows;
  rows.offset.assign(static_cast<std::size_t>(groups), 0.0);
  for (int g = 0; g < groups; ++g) precision(g, g) = 1.0;
  for (std::size_t i = 0; i < evidence.size(); ++i) {
    const RowEvidence& e = evidence[i];
    const int index[3] = {e.group, e.above, e.below};
    const double factor[3] = {1.0, -0.5, -0.5};
    for (int a = 0; a < 3; ++a) {
      rows.offset[static_cast<std::size_t>(index[a])] += factor[a] * e.value / variance[i];
      for (int b = 0; b < 3; ++b)
        if (index[a] >= index[b])
          precision(index[a], index[b]) += factor[a] * factor[b] / variance[i];
    }
  }
  factorize(precision);
  solve(precision, rows.offset);
  const Band inverse = inverse_in_band(precision);
  for (int g = 0; g < groups; ++g) rows.deviation.push_back(std::sqrt(inverse(g, g)));
  return rows;
}

}  // namespace malus
