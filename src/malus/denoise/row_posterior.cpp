#include "malus/denoise/internal/row_posterior.h"

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

// Where an offset stands among the unknowns, of which a drifting one has two: itself, and the slow
// part of it.
struct Unknowns {
  int groups, per_group;
  int offset(int group) const { return group * per_group; }
  int slow(int group) const { return group * per_group + 1; }
};

// Precision of the offsets before any evidence. Given the slow part, which is a first-order
// autoregressive sequence, offsets are independent (row_drift.h), so that two unknowns of a group
// keep the matrix a band where offsets alone would fill it.
void add_prior(const RowDrift& drift, const Unknowns& at, Band& precision) {
  constexpr double kLeastWhite = 1e-3;  // else offset and slow part are one
  if (at.per_group == 1) {
    for (int g = 0; g < at.groups; ++g) precision(g, g) += 1.0;
    return;
  }
  const double white = 1.0 / std::max(1.0 - drift.share, kLeastWhite);
  const double decay = std::exp(-1.0 / drift.length_groups);
  const double fresh = 1.0 / (drift.share * (1.0 - decay * decay));
  for (int g = 0; g < at.groups; ++g) {
    precision(at.offset(g), at.offset(g)) += white;
    precision(at.slow(g), at.offset(g)) -= white;
    precision(at.slow(g), at.slow(g)) += white + (g == 0 ? 1.0 / drift.share : fresh);
    if (g == 0) continue;
    precision(at.slow(g - 1), at.slow(g - 1)) += decay * decay * fresh;
    precision(at.slow(g), at.slow(g - 1)) -= decay * fresh;
  }
}

}  // namespace

RowNoise row_posterior(const std::vector<RowEvidence>& evidence,
                       const std::vector<double>& variance, int groups, const RowDrift& drift) {
  MALUS_REQUIRE(evidence.size() == variance.size());
  const Unknowns at{groups, drift.white() ? 1 : 2};
  Band precision(groups * at.per_group, std::max(width_of(evidence), 1) * at.per_group);
  add_prior(drift, at, precision);
  std::vector<double> mean(static_cast<std::size_t>(precision.size()));
  for (std::size_t i = 0; i < evidence.size(); ++i) {
    const RowEvidence& e = evidence[i];
    const int index[3] = {at.offset(e.group), at.offset(e.above), at.offset(e.below)};
    const double factor[3] = {1.0, -0.5, -0.5};
    for (int a = 0; a < 3; ++a) {
      mean[static_cast<std::size_t>(index[a])] += factor[a] * e.value / variance[i];
      for (int b = 0; b < 3; ++b)
        if (index[a] >= index[b])
          precision(index[a], index[b]) += factor[a] * factor[b] / variance[i];
    }
  }
  factorize(precision);
  solve(precision, mean);
  const Band inverse = inverse_in_band(precision);
  RowNoise rows;
  for (int g = 0; g < groups; ++g) {
    const int i = at.offset(g);
    rows.offset.push_back(mean[static_cast<std::size_t>(i)]);
    rows.deviation.push_back(std::sqrt(inverse(i, i)));
  }
  return rows;
}

}  // namespace malus
