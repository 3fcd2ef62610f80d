// A value that so many of a picture's lie below.
#pragma once

#include <vector>

namespace malus::internal {

/// The order statistic of rank floor(percent / 100 * (n - 1)) of the n finite values; 0 when there
/// are none.
double percentile(std::vector<float> values, double percent);

}  // namespace malus::internal
