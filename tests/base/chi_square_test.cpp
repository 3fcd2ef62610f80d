#include "malus/base/chi_square.h"

#include <gtest/gtest.h>

namespace malus {
namespace {

// Quantiles of tables (Abramowitz and Stegun, table 26.8) of these shares of the normal law.
TEST(ChiSquare, LimitsAreThoseOfTables) {
  constexpr double kHalf = 0.0, k95 = 1.6448536, k999 = 3.0902323;
  EXPECT_NEAR(chi_square_ratio(kHalf, 16), 15.3385 / 16, 5e-4);
  EXPECT_NEAR(chi_square_ratio(k95, 10), 18.3070 / 10, 2e-3);
  EXPECT_NEAR(chi_square_ratio(k999, 10), 29.5883 / 10, 0.02);
  EXPECT_NEAR(chi_square_ratio(k999, 30), 59.7031 / 30, 4e-3);
}

TEST(ChiSquare, DeviateAndRatioAreInverse) {
  for (const double freedom : {1.0, 2.5, 16.0, 1000.0})
    for (const double deviate : {-1.0, 0.0, 1.5, 4.5})
      EXPECT_NEAR(chi_square_deviate(chi_square_ratio(deviate, freedom), freedom), deviate, 1e-9)
          << freedom;
}

}  // namespace
}  // namespace malus
