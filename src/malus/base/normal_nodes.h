// Means over a standard normal variable by five points (Gauss-Hermite; Abramowitz and Stegun, table
// 25.10): exact of polynomials up to the ninth degree.
#pragma once

#include <array>

namespace malus {

struct NormalNode {
  double at = 0, weight = 0;  ///< in deviations; the weights add to 1
};

inline constexpr std::array<NormalNode, 5> kNormalNodes{
    {{-2.8569700138728056, 0.011257411327720691},
     {-1.3556261799742659, 0.22207592200561266},
     {0.0, 0.53333333333333333},
     {1.3556261799742659, 0.22207592200561266},
     {2.8569700138728056, 0.011257411327720691}}};

}  // namespace malus
