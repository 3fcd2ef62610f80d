#include "malus/denoise/internal/sampled_pixels.h"

#include <set>
#include <utility>

#include <gtest/gtest.h>

namespace malus::internal {
namespace {

TEST(SampledPixels, AreOfAllChannelsOfAnyCell) {
  for (const auto& [rows, cols] : {std::pair{600, 720}, {2048, 2448}}) {
    const Image dn(rows, cols);
    for (const int side : {1, 3, 4, 5, 6, 7, 8}) {
      std::set<std::pair<int, int>> places;
      std::size_t count = 0;
      for_each_sampled(dn, 4096, [&](int row, int col) {
        places.emplace(row % side, col % side);
        ++count;
      });
      EXPECT_EQ(std::ssize(places), side * side) << side << " of " << cols;
      EXPECT_NEAR(static_cast<double>(count), 4096, 50);
    }
  }
}

TEST(SampledPixels, OfFewAreAll) {
  const Image dn(20, 30);
  std::set<std::pair<int, int>> places;
  for_each_sampled(dn, 4096, [&](int row, int col) { places.emplace(row, col); });
  EXPECT_EQ(places.size(), 600U);
}

}  // namespace
}  // namespace malus::internal
