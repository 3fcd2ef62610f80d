#include "malus/base/normal_distribution.h"

#include "malus/base/normal_nodes.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

// 1, 3, 15 and 105 are a standard normal variable's even moments.
TEST(NormalNodes, GiveTheMomentsUpToTheEighth) {
  for (const auto& [power, moment] :
       {std::pair{0, 1.0}, {2, 1.0}, {4, 3.0}, {6, 15.0}, {8, 105.0}}) {
    double sum = 0;
    for (const NormalNode& node : kNormalNodes) sum += node.weight * std::pow(node.at, power);
    EXPECT_NEAR(sum, moment, 1e-14 * moment) << power;
  }
}

TEST(NormalDistribution, MeanAboveZeroIsTheIntegralOfTheProbability) {
  constexpr double kStep = 1e-3;
  double sum = 0;
  for (double z = -9 + kStep / 2; z < 1.5; z += kStep) sum += kStep * normal_cdf(z);
  EXPECT_NEAR(mean_above_zero(1.5), sum, 1e-7);
  EXPECT_NEAR(mean_above_zero(0), std::sqrt(1 / (2 * 3.14159265358979)), 1e-12);
}

}  // namespace
}  // namespace malus
