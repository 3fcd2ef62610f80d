#include "malus/io/internal/glob.h"

#include <algorithm>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus::internal {
namespace {

TEST(NaturalOrder, DigitsCompareAsNumbers) {
  std::vector<std::string> names = {"f10",
                                    "f9",
                                    "f1b",
                                    "f1a",
                                    "f01",
                                    "f1",
                                    "f",
                                    "g0",
                                    "f100000000000000000000000",
                                    "f99999999999999999999999"};
  std::sort(names.begin(), names.end(), natural_less);
  EXPECT_THAT(
      names, ::testing::ElementsAre("f", "f01", "f1", "f1a", "f1b", "f9", "f10",
                                    "f99999999999999999999999", "f100000000000000000000000", "g0"));
}

TEST(NaturalOrder, IsAStrictOrder) {
  const std::vector<std::string> names = {"", "0", "00", "1", "01", "a", "a0", "a00b", "a0b", "a1"};
  for (const auto& a : names) {
    EXPECT_FALSE(natural_less(a, a));
    for (const auto& b : names) {
      EXPECT_EQ(a != b, natural_less(a, b) != natural_less(b, a)) << a << " " << b;
      for (const auto& c : names)
        EXPECT_TRUE(!natural_less(a, b) || !natural_less(b, c) || natural_less(a, c))
            << a << " " << b << " " << c;
    }
  }
}

}  // namespace
}  // namespace malus::internal
