// What both tests of the device's noise draw, and how they compare it with the CPU's.
#pragma once

#include "malus/image/view.h"

#include <bit>
#include <cstdint>

#include <gtest/gtest.h>

namespace malus::testing {

/// From below black to far above, every regime of the shot noise in every channel.
inline Image levels(int rows, int cols) {
  Image clean(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      clean(r, c) =
          static_cast<float>((r * 31 + c * 17) % 97) * 0.7f - 5.0f + static_cast<float>(r * r);
  return clean;
}

inline void expect_same_bits(const Image& cpu, const Image& gpu) {
  for (int r = 0; r < cpu.rows(); ++r)
    for (int c = 0; c < cpu.cols(); ++c)
      ASSERT_EQ(std::bit_cast<std::uint32_t>(cpu(r, c)), std::bit_cast<std::uint32_t>(gpu(r, c)))
          << r << ' ' << c << ": " << cpu(r, c) << " on the CPU, " << gpu(r, c) << " on the device";
}

}  // namespace malus::testing
