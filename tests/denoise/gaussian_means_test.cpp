#include "malus/denoise/internal/gaussian_means.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus::internal {
namespace {

double plain_mean(const Image& from, int row, int col, double deviation, int radius) {
  double sum = 0, weight = 0;
  for (int i = -radius; i <= radius; ++i)
    for (int k = -radius; k <= radius; ++k) {
      const int r = row + i, c = col + k;
      if (r < 0 || c < 0 || r >= from.rows() || c >= from.cols()) continue;
      const double share = std::exp(-0.5 * (i * i + k * k) / (deviation * deviation));
      sum += share * from(r, c);
      weight += share;
    }
  return sum / weight;
}

// Also of images narrower than the weights reach.
TEST(GaussianMeans, AreWeightedMeansOfWhatLiesInside) {
  struct Size {
    int rows, cols;
  };
  for (const Size size : {Size{40, 33}, Size{3, 50}, Size{50, 3}, Size{1, 1}}) {
    Image image(size.rows, size.cols);
    for (int r = 0; r < size.rows; ++r)
      for (int c = 0; c < size.cols; ++c)
        image(r, c) = static_cast<float>(std::sin(1.3 * r) * std::cos(0.7 * c) + 0.1 * c);
    const Image means = gaussian_means(image, 2.5f, 6);
    ASSERT_EQ(means.rows(), size.rows);
    ASSERT_EQ(means.cols(), size.cols);
    for (int r = 0; r < size.rows; ++r)
      for (int c = 0; c < size.cols; ++c)
        EXPECT_NEAR(means(r, c), plain_mean(image, r, c, 2.5, 6), 1e-5) << r << ' ' << c;
  }
}

}  // namespace
}  // namespace malus::internal
