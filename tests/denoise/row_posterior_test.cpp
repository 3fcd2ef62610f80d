#include "malus/denoise/internal/row_posterior.h"

#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

// Gauss-Jordan elimination; exact to rounding for the small matrices here.
std::vector<std::vector<double>> dense_inverse(std::vector<std::vector<double>> matrix) {
  const std::size_t n = matrix.size();
  std::vector<std::vector<double>> inverse(n, std::vector<double>(n));
  for (std::size_t i = 0; i < n; ++i) inverse[i][i] = 1;
  for (std::size_t i = 0; i < n; ++i) {
    const double pivot = matrix[i][i];
    for (std::size_t c = 0; c < n; ++c) matrix[i][c] /= pivot, inverse[i][c] /= pivot;
    for (std::size_t r = 0; r < n; ++r) {
      if (r == i) continue;
      const double factor = matrix[r][i];
      for (std::size_t c = 0; c < n; ++c)
        matrix[r][c] -= factor * matrix[i][c], inverse[r][c] -= factor * inverse[i][c];
    }
  }
  return inverse;
}

// Precision of offsets that are drawn with this drift.
std::vector<std::vector<double>> prior_precision(int groups, const RowDrift& drift) {
  std::vector<std::vector<double>> covariance(
      static_cast<std::size_t>(groups), std::vector<double>(static_cast<std::size_t>(groups)));
  for (int a = 0; a < groups; ++a)
    for (int b = 0; b < groups; ++b)
      covariance[static_cast<std::size_t>(a)][static_cast<std::size_t>(b)] =
          row_autocorrelation(drift, std::abs(a - b));
  return dense_inverse(covariance);
}

class RowPosterior : public ::testing::TestWithParam<RowDrift> {};

TEST_P(RowPosterior, MeanAndDeviationsAreThoseOfAll) {
  constexpr int kGroups = 40;
  std::vector<RowEvidence> evidence;
  std::vector<double> variance, right(kGroups);
  std::vector<std::vector<double>> precision = prior_precision(kGroups, GetParam());
  for (const int distance : {1, 2, 4})
    for (int g = distance; g + distance < kGroups; ++g) {
      if (g % 7 == 3) continue;  // a row that tells nothing
      evidence.push_back({g, g - distance, g + distance, std::sin(1.7 * g + distance), 1.0});
      variance.push_back(0.01 * (1 + g % 5));
      const std::pair<std::size_t, double> terms[] = {
          {g, 1.0}, {g - distance, -0.5}, {g + distance, -0.5}};
      for (const auto& [a, x] : terms) {
        right[a] += x * evidence.back().value / variance.back();
        for (const auto& [b, y] : terms) precision[a][b] += x * y / variance.back();
      }
    }
  const RowNoise rows = row_posterior(evidence, variance, kGroups, GetParam());
  const auto inverse = dense_inverse(precision);
  for (std::size_t g = 0; g < kGroups; ++g) {
    double mean = 0;
    for (std::size_t k = 0; k < kGroups; ++k) mean += inverse[g][k] * right[k];
    EXPECT_NEAR(rows.offset[g], mean, 1e-10);
    EXPECT_NEAR(rows.deviation[g], std::sqrt(inverse[g][g]), 1e-10);
  }
}

INSTANTIATE_TEST_SUITE_P(Drifts, RowPosterior,
                         ::testing::Values(RowDrift{}, RowDrift{0.33, 2.0}, RowDrift{0.9, 20.0}));

}  // namespace
}  // namespace malus
