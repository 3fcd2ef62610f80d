#include "malus/noise/variance_curve.h"

#include <algorithm>
#include <cmath>

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

TEST(WithPattern, AddsWhatPixelsDifferBy) {
  for (const VarianceCurve& temporal :
       {VarianceCurve::affine(0.5, 4), VarianceCurve::table({0, 100}, {4, 54}, 0.5)}) {
    const VarianceCurve curve = temporal.with_pattern(0.01, 3);
    EXPECT_FALSE(curve.is_affine());
    for (const double signal : {-20.0, 0.0, 100.0, 3000.0}) {
      const double pattern = std::pow(0.01 * std::max(signal, 0.0), 2) + 9;
      EXPECT_DOUBLE_EQ(curve(signal), temporal(signal) + pattern);
      EXPECT_DOUBLE_EQ(curve.scaled(0.3)(signal), 0.3 * curve(signal));
      EXPECT_EQ(curve.temporal()(signal), temporal(signal));
      EXPECT_EQ(temporal.with_pattern(0, 0)(signal), temporal(signal));
    }
  }
  EXPECT_TRUE(VarianceCurve::affine(0.5, 4).with_pattern(0.01, 3).temporal().is_affine());
}

}  // namespace
}  // namespace malus
