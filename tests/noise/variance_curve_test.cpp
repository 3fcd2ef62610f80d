#include "malus/noise/variance_curve.h"

#include <algorithm>

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(FlooredLine, IsTheLineOrItsFloorWhicheverIsHigher) {
  for (const double slope : {0.0, 0.5})
    for (const double offset : {-30.0, -1.0, 0.0, 0.5, 4.0}) {
      const VarianceCurve curve = VarianceCurve::floored_line(slope, offset, 2);
      for (const double signal : {0.0, 1.0, 3.5, 60.0, 200.0})
        EXPECT_DOUBLE_EQ(curve(signal), std::max(slope * signal + offset, 2.0))
            << slope << ' ' << offset << " at " << signal;
    }
}

TEST(FittedLine, HasItsFloorOnlyWhereTheOffsetIsBelowZero) {
  EXPECT_DOUBLE_EQ(VarianceCurve::fitted_line(0.5, 0.5, 2)(0), 0.5);
  EXPECT_DOUBLE_EQ(VarianceCurve::fitted_line(0.5, -0.5, 2)(0), 2);
  EXPECT_DOUBLE_EQ(VarianceCurve::fitted_line(0, -0.5, 2)(0), 0);
}

}  // namespace
}  // namespace malus
