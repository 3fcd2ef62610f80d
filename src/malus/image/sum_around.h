// The smoothest sum over a value and its neighbours that 3x3 values give.
#pragma once

#include "malus/image/view.h"

#include <algorithm>
#include <cstdlib>

namespace malus {

/// Sum over the 3x3 values around with the weights 1 2 1 each way, 16 in all; beyond the border the
/// nearest value counts. Contract: row and col lie inside.
inline double sum_around(View<const float> values, int row, int col) {
  double sum = 0;
  for (int a = -1; a <= 1; ++a)
    for (int b = -1; b <= 1; ++b)
      sum += static_cast<double>((2 - std::abs(a)) * (2 - std::abs(b))) *
             static_cast<double>(values(std::clamp(row + a, 0, values.rows() - 1),
                                        std::clamp(col + b, 0, values.cols() - 1)));
  return sum;
}

}  // namespace malus
