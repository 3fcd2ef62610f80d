#include "malus/noise/matrix.h"

#include <cmath>

#include "support.h"

namespace malus {
namespace {

SquareMatrix matrix3(std::vector<double> values) {
  SquareMatrix m(3);
  m.values = std::move(values);
  return m;
}

// Higham 2002, section 4: the nearest correlation matrix of [1 1 0; 1 1 1; 0 1 1].
TEST(NearestCorrelation, HighamsExample) {
  const SquareMatrix nearest = nearest_correlation(matrix3({1, 1, 0, 1, 1, 1, 0, 1, 1}));
  const SquareMatrix published = matrix3({1, 0.7607, 0.1573, 0.7607, 1, 0.7607, 0.1573, 0.7607, 1});
  EXPECT_LT(largest_difference(nearest, published), 5e-5);
}

TEST(NearestCorrelation, LeavesACorrelationMatrixAlone) {
  const SquareMatrix m = matrix3({1, 0.5, 0.1, 0.5, 1, -0.3, 0.1, -0.3, 1});
  EXPECT_LT(largest_difference(nearest_correlation(m), m), 1e-12);
}

TEST(NearestCorrelation, KeepsEntriesWithinOne) {
  const SquareMatrix nearest = nearest_correlation(matrix3({1, 1.3, 0, 1.3, 1, 0, 0, 0, 1}));
  EXPECT_NEAR(nearest(0, 1), 1.0, 1e-9);
  EXPECT_EQ(nearest(1, 1), 1.0);
}

// Eigenvalues 3 and -1: the second one's part, -1/2 [1 -1; -1 1], goes.
TEST(NearestSemidefinite, DropsTheNegativeEigenvalue) {
  const SquareMatrix nearest = nearest_semidefinite(matrix3({1, 2, 0, 2, 1, 0, 0, 0, 5}));
  EXPECT_LT(largest_difference(nearest, matrix3({1.5, 1.5, 0, 1.5, 1.5, 0, 0, 0, 5})), 1e-12);
}

TEST(Correlation, IgnoresChannelsWithoutVariance) {
  const SquareMatrix r = correlation_of(matrix3({4, 3, 1, 3, 9, 1, 1, 1, -0.1}));
  EXPECT_DOUBLE_EQ(r(0, 1), 0.5);
  EXPECT_EQ(r(0, 2), 0.0);
  EXPECT_EQ(r(2, 2), 1.0);
}

TEST(Correlation, CovarianceRoundTrip) {
  const SquareMatrix covariance = matrix3({4, 3, 1, 3, 9, 1, 1, 1, 25});
  const std::vector<double> deviation = {2, 3, 5};
  EXPECT_LT(largest_difference(covariance_of(correlation_of(covariance), deviation), covariance),
            1e-14);
}

}  // namespace
}  // namespace malus
