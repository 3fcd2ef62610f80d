#include "malus/image/quantization.h"

#include <limits>

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(QuantizationStep, IsTheGreatestCommonDivisorOfTheDifferences) {
  Image dn(2, 3, 15.0F);
  dn(0, 1) = 47;
  dn(1, 2) = 15 + 16 * 7;
  EXPECT_EQ(quantization_step(dn), 16.0);
  dn(1, 1) = 16;
  EXPECT_EQ(quantization_step(dn), 1.0);
  for (const float value : {15.5F, 1e30F, std::numeric_limits<float>::infinity()}) {
    dn(1, 0) = value;
    EXPECT_EQ(quantization_step(dn), 0.0);
  }
  EXPECT_EQ(quantization_step(Image(0, 5)), 0.0);
}

TEST(CodeSpacing, IsOfTheCodesInUse) {
  std::vector<float> pixels;
  for (int i = 0; i < 4000; ++i) pixels.push_back(static_cast<float>(3 * (i % 40)));
  EXPECT_NEAR(code_spacing(pixels), 3.0, 1e-6);
  pixels.resize(400);  // 5 per code of the middle half: some would be missed
  EXPECT_EQ(code_spacing(pixels), 0.0);
  EXPECT_EQ(code_spacing(std::vector<float>(1000, 7.0F)), 0.0);
  EXPECT_EQ(code_spacing({}), 0.0);
}

// Narrow noise on codes 64 apart; a dead row and hot pixels are no codes in use.
TEST(OccupiedSpacing, IsOfTheCodesThatManyPixelsHave) {
  std::vector<float> pixels;
  const auto add = [&](int count, float dn) {
    pixels.insert(pixels.end(), std::size_t(count), dn);
  };
  add(900, 1025);
  add(700, 1089);
  add(300, 961);
  add(40, 0);
  for (int i = 0; i < 30; ++i) add(1, static_cast<float>(1500 + 7 * i));
  EXPECT_EQ(occupied_spacing(pixels), 64.0);
  add(400, 1000);
  add(10, 1050);
  EXPECT_EQ(occupied_spacing(pixels), 128.0 / 4);
  EXPECT_EQ(occupied_spacing(std::vector<float>(1000, 7.0F)), 0.0);
  EXPECT_EQ(occupied_spacing({}), 0.0);
}

TEST(LeftOutCode, IsOneThatBothNeighboursHaveManyOf) {
  std::vector<float> pixels;
  const auto add = [&](int count, float dn) {
    pixels.insert(pixels.end(), std::size_t(count), dn);
  };
  add(300, 62);
  add(900, 66);
  EXPECT_FALSE(left_out_code(pixels, 1));  // three codes are missing
  EXPECT_EQ(left_out_code(pixels, 2), 64.0);
  add(500, 64);
  EXPECT_FALSE(left_out_code(pixels, 2));
  EXPECT_EQ(left_out_code(pixels, 1), 65.0);  // between the most
  add(40, 70);                                // far out, few have any
  EXPECT_FALSE(left_out_code(pixels, 2));
  EXPECT_FALSE(left_out_code(pixels, 0));
  EXPECT_FALSE(left_out_code({}, 1));
}

}  // namespace
}  // namespace malus
