// Against textbook formulas and plain loops.
#include "malus/base/statistics.h"

#include "malus/base/random.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

// sum (x - mean)² = 5, slope 7/5, residuals 0.1 -0.3 0.3 -0.1.
TEST(FitLine, OfEqualWeightsIsTheTextbooks) {
  const std::vector<double> x = {1, 2, 3, 4}, y = {2, 3, 5, 6};
  const LineFit line = fit_line(x, y);
  EXPECT_NEAR(line.slope, 1.4, 1e-12);
  EXPECT_NEAR(line.intercept, 0.5, 1e-12);
  EXPECT_NEAR(line.residual_deviation, std::sqrt(0.1), 1e-12);
  EXPECT_NEAR(line.slope_standard_error, std::sqrt(0.1 / 5), 1e-12);
  EXPECT_NEAR(line.intercept_standard_error, std::sqrt(0.1 * (1.0 / 4 + 2.5 * 2.5 / 5)), 1e-12);
}

TEST(FitLine, OfWeightsThatAreKnownTakesItsErrorsFromThem) {
  const std::vector<double> x = {1, 2, 3, 4}, y = {2, 3, 5, 6}, weight(4, 4.0);  // 0.5 each
  const LineFit line = fit_line(x, y, weight, true);
  EXPECT_NEAR(line.slope, 1.4, 1e-12);
  EXPECT_NEAR(line.slope_standard_error, 0.5 / std::sqrt(5), 1e-12);
  EXPECT_NEAR(line.intercept_standard_error, 0.5 * std::sqrt(1.0 / 4 + 2.5 * 2.5 / 5), 1e-12);
}

// Mean x 1.25, sum w (x - mean)² = 4.75, slope 12/19, sum w r² = 2/19.
TEST(FitLine, OfUnequalWeightsIsTheTextbooks) {
  const std::vector<double> x = {0, 1, 3}, y = {1, 2, 3}, weight = {1, 2, 1};
  const LineFit line = fit_line(x, y, weight);
  EXPECT_NEAR(line.slope, 12.0 / 19, 1e-12);
  EXPECT_NEAR(line.intercept, 2 - 1.25 * 12 / 19, 1e-12);
  EXPECT_NEAR(line.residual_deviation, std::sqrt(2.0 / 19 * 3 / 4), 1e-12);
  EXPECT_NEAR(line.slope_standard_error, std::sqrt(2.0 / 19 / 4.75), 1e-12);
  EXPECT_NEAR(line.intercept_standard_error, std::sqrt(2.0 / 19 * (1.0 / 4 + 1.25 * 1.25 / 4.75)),
              1e-12);
}

TEST(FitLine, ThroughTwoPointsHasNoErrorOfItsOwn) {
  const std::vector<double> x = {1, 3}, y = {2, 8};
  const LineFit line = fit_line(x, y);
  EXPECT_NEAR(line.slope, 3, 1e-12);
  EXPECT_NEAR(line.intercept, -1, 1e-12);
  EXPECT_EQ(line.slope_standard_error, 0);
  EXPECT_EQ(line.intercept_standard_error, 0);
}

TEST(RootStandardError, IsOfFirstOrderFarFromZeroAndARangeAtIt) {
  EXPECT_NEAR(root_standard_error(100, 0.1), 0.1 / (2 * 10), 1e-5);
  for (const double square : {0.0, -3.0})
    EXPECT_NEAR(root_standard_error(square, 0.04), 0.2, 1e-12);
}

TEST(Moments, AreThoseOfALoopHoweverTheyAreMerged) {
  RandomSequence random(3, 0, Draw::kOther);
  std::vector<double> values;
  for (int i = 0; i < 50; ++i) values.push_back(std::exp(random.normal()));
  const auto n = static_cast<double>(values.size());
  double mean = 0, second = 0, fourth = 0;
  for (const double v : values) mean += v / n;
  for (const double v : values) {
    second += std::pow(v - mean, 2);
    fourth += std::pow(v - mean, 4) / n;
  }
  const double variance = second / (n - 1);
  const double error = std::sqrt((fourth - variance * variance * (n - 3) / (n - 1)) / n);
  for (const std::size_t cut : {0u, 1u, 17u, 50u}) {
    Moments first, rest;
    for (std::size_t i = 0; i < values.size(); ++i) (i < cut ? first : rest).add(values[i]);
    first.merge(rest);
    EXPECT_EQ(first.count(), 50);
    EXPECT_NEAR(first.mean(), mean, 1e-12);
    EXPECT_NEAR(first.variance(), variance, 1e-12 * variance);
    EXPECT_NEAR(first.variance_standard_error(), error, 1e-10 * error);
  }
}

}  // namespace
}  // namespace malus
