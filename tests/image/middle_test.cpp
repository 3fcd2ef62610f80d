#include "malus/image/middle.h"

#include <array>
#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

// Every pixel says where it was.
Image numbered(int rows, int cols) {
  Image image(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) image(r, c) = static_cast<float>(1000 * r + c);
  return image;
}

TEST(Middle, KeepsTheLayoutsPhaseAndWholeCells) {
  for (const char* name : {"mono", "bayer-grbg", "polar-mono", "polar-bayer-rggb"}) {
    const SensorLayout layout = SensorLayout::named(name);
    for (const auto& [rows, cols, side] :
         {std::array{30, 41, 16}, std::array{37, 23, 19}, std::array{12, 90, 50}}) {
      const Image middle = middle_of(numbered(rows, cols), layout, side);
      const int row0 = static_cast<int>(middle(0, 0)) / 1000;
      const int col0 = static_cast<int>(middle(0, 0)) % 1000;
      EXPECT_EQ(layout.channel_at(row0, col0), 0) << name;
      EXPECT_EQ(middle.rows() % layout.rows(), 0) << name;
      EXPECT_EQ(middle.cols() % 2, 0) << name;
      EXPECT_LE(middle.rows(), side) << name;
      EXPECT_GT(middle.rows() + 4, std::min(rows, side)) << name;
      // As much is cut off on both sides, to the cell.
      EXPECT_LE(std::abs(rows - middle.rows() - 2 * row0), 8) << name;
      EXPECT_LE(std::abs(cols - middle.cols() - 2 * col0), 8) << name;
      EXPECT_EQ(middle(middle.rows() - 1, middle.cols() - 1),
                1000 * (row0 + middle.rows() - 1) + col0 + middle.cols() - 1)
          << name;
    }
  }
}

TEST(Middle, KeepsWholeRowGroups) {
  const SensorLayout layout = SensorLayout::named("polar-mono");
  for (const int group : {2, 3, 8}) {
    const MosaicWindow window = middle_window(100, 70, layout, 40, group);
    EXPECT_EQ(window.row0 % group, 0);
    EXPECT_EQ(window.rows % group, 0);
    EXPECT_EQ(window.row0 % 2 + window.rows % 2 + window.col0 % 2, 0);
    EXPECT_EQ(window.cols, 40);
    EXPECT_LE(std::abs(100 - window.rows - 2 * window.row0), 2 * 2 * group);
  }
  EXPECT_EQ(middle_window(100, 70, layout, 40, 64).rows, 0);
}

TEST(Middle, IsEmptyWhereThereIsNoWholeCell) {
  const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  EXPECT_TRUE(middle_of(numbered(3, 40), layout, 16).values().empty());
  EXPECT_TRUE(middle_of(numbered(40, 40), layout, 3).values().empty());
}

}  // namespace
}  // namespace malus
