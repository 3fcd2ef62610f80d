// Moments of what was drawn, and how far they may lie from the law's.
#pragma once

#include "malus/base/statistics.h"
#include "malus/image/view.h"

namespace malus::testing {

/// Five standard errors: a false alarm in two million runs, and the seeds are fixed anyway.
inline constexpr double kSigmas = 5;

inline Moments moments_of(const Image& image) {
  Moments moments;
  for (const float v : image.values()) moments.add(static_cast<double>(v));
  return moments;
}

}  // namespace malus::testing
