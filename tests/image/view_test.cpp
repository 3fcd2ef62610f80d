#include "malus/image/view.h"

#include <limits>

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(View, WindowsLieInside) {
  Image image(4, 5);
  image(2, 3) = 7;
  EXPECT_EQ(image.view().window(1, 2, 3, 3)(1, 1), 7);
  EXPECT_EQ(image.view().window(4, 5, 0, 0).rows(), 0);
  EXPECT_THROW(image.view().window(1, 0, 4, 5), ContractViolation);
  EXPECT_THROW(image.view().window(0, 5, 4, 1), ContractViolation);
}

// Row and rows add up to more than an int holds.
TEST(View, WindowsOfHugeSizeAreRefused) {
  constexpr int kMost = std::numeric_limits<int>::max();
  Image image(4, 5);
  EXPECT_THROW(image.view().window(1, 0, kMost, 5), ContractViolation);
  EXPECT_THROW(image.view().window(0, 1, 4, kMost), ContractViolation);
}

#ifdef MALUS_CHECK_ACCESS
TEST(View, ElementsOutsideAreRefusedWhereAccessIsChecked) {
  Image image(4, 5);
  EXPECT_THROW(image(0, 5), ContractViolation);
  EXPECT_THROW(image(4, 0), ContractViolation);
  EXPECT_THROW(image.row(-1), ContractViolation);
}
#endif

}  // namespace
}  // namespace malus
