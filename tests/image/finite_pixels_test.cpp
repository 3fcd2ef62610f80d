#include "malus/image/finite_pixels.h"

#include <limits>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinite = std::numeric_limits<float>::infinity();

TEST(FinitePixels, OthersTakeNoPart) {
  Image pixels(2, 3, kNan);
  EXPECT_EQ(finite_mean(pixels.view()), 0);
  EXPECT_EQ(finite_largest(pixels.view()), 0);
  pixels(0, 1) = kInfinite;
  pixels(0, 2) = 5;
  pixels(1, 0) = -2;
  EXPECT_DOUBLE_EQ(finite_mean(pixels.view()), 1.5);
  EXPECT_DOUBLE_EQ(finite_largest(pixels.view()), 5);
  pixels(0, 2) = -1;
  EXPECT_EQ(finite_largest(pixels.view()), 0);  // a white level is none below black
}

}  // namespace
}  // namespace malus
