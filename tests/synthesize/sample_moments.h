// Moments of what was drawn, and how far they may lie from the law's.
#pragma once

#include "malus/base/statistics.h"
#include "malus/image/view.h"

#include <cmath>

namespace malus::testing {

/// Five standard errors: a false alarm in two million runs, and the seeds are fixed anyway.
inline constexpr double kSigmas = 5;

inline Moments moments_of(const Image& image) {
  Moments moments;
  for (const float v : image.values()) moments.add(static_cast<double>(v));
  return moments;
}

/// g2 = m4 / m2² - 3, of many: what the error of the variance holds of it.
inline double excess_kurtosis_of(const Moments& moments) {
  const auto n = static_cast<double>(moments.count());
  return n * std::pow(moments.variance_standard_error() / moments.variance(), 2) - 2;
}

}  // namespace malus::testing
