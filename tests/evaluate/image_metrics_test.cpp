#include "malus/evaluate/image_metrics.h"

#include "malus/base/parallel.h"
#include "malus/base/random.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

Image random_image(int rows, int cols, std::uint32_t frame, double mean = 0.5, double sd = 0.2) {
  RandomSequence random(5, frame, Draw::kOther);
  Image image(rows, cols);
  for (float& v : image.values()) v = static_cast<float>(mean + sd * random.normal());
  return image;
}

Planes one_plane(const Image& image) {
  Planes planes(1, image.rows(), image.cols());
  planes[0] = image;
  return planes;
}

TEST(Psnr, ClosedForms) {
  Planes a(2, 10, 10), b(2, 10, 10);
  for (float& v : b[0].values()) v = 10.0f;  // half of all pixels off by 10: MSE 50
  EXPECT_NEAR(*psnr_db(a, b, 255), 10 * std::log10(255.0 * 255.0 / 50), 1e-9);
  for (float& v : b[0].values()) v = 0.1f;
  for (float& v : b[1].values()) v = -0.1f;
  EXPECT_NEAR(*psnr_db(a, b, 1), 20, 1e-5);
  EXPECT_TRUE(std::isinf(*psnr_db(a, a, 1)));
}

TEST(Psnr, BrokenPixelsAreLeftOutAndNothingLeftIsUndecided) {
  Planes a(1, 2, 2), b(1, 2, 2);
  b[0](0, 0) = 0.5f;
  a[0](1, 1) = std::numeric_limits<float>::quiet_NaN();
  b[0](1, 0) = std::numeric_limits<float>::infinity();
  EXPECT_EQ(squared_error(a[0], b[0]).count, 2);
  EXPECT_NEAR(*psnr_db(a, b, 1), 10 * std::log10(2 / 0.25), 1e-9);
  for (float& v : a[0].values()) v = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(psnr_db(a, b, 1).decided());
}

TEST(Ssim, ConstantPicturesAreTheLuminanceTermAlone) {
  const double x = 0.3, y = 0.8, c1 = 1e-4;
  const Image a(20, 30, static_cast<float>(x)), b(20, 30, static_cast<float>(y));
  EXPECT_NEAR(*ssim(a.view(), b.view(), 1), (2 * x * y + c1) / (x * x + y * y + c1), 1e-6);
  EXPECT_NEAR(*ssim(a.view(), a.view(), 1), 1, 1e-12);
}

// The definition of the paper, window by window with its two-dimensional Gaussian.
double ssim_by_definition(const Image& a, const Image& b, double peak) {
  double total = 0;
  int windows = 0;
  for (int r = 5; r < a.rows() - 5; ++r)
    for (int c = 5; c < a.cols() - 5; ++c) {
      double weight = 0, ma = 0, mb = 0;
      const auto w = [](int i, int j) { return std::exp(-(i * i + j * j) / (2 * 1.5 * 1.5)); };
      for (int i = -5; i <= 5; ++i)
        for (int j = -5; j <= 5; ++j) {
          weight += w(i, j);
          ma += w(i, j) * a(r + i, c + j);
          mb += w(i, j) * b(r + i, c + j);
        }
      ma /= weight, mb /= weight;
      double va = 0, vb = 0, vab = 0;
      for (int i = -5; i <= 5; ++i)
        for (int j = -5; j <= 5; ++j) {
          const double da = a(r + i, c + j) - ma, db = b(r + i, c + j) - mb;
          va += w(i, j) * da * da / weight;
          vb += w(i, j) * db * db / weight;
          vab += w(i, j) * da * db / weight;
        }
      const double c1 = std::pow(0.01 * peak, 2), c2 = std::pow(0.03 * peak, 2);
      total += (2 * ma * mb + c1) * (2 * vab + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2));
      ++windows;
    }
  return total / windows;
}

TEST(Ssim, EqualsItsDefinitionOnOddSizesAndAnyPeak) {
  for (const auto& [rows, cols] : {std::pair{11, 11}, {12, 37}, {45, 13}})
    for (double peak : {1.0, 4095.0}) {
      Image a = random_image(rows, cols, 1), b = random_image(rows, cols, 2);
      for (std::size_t i = 0; i < a.size(); ++i) {
        b.values()[i] = static_cast<float>(peak) * (0.7f * a.values()[i] + 0.3f * b.values()[i]);
        a.values()[i] *= static_cast<float>(peak);
      }
      EXPECT_NEAR(*ssim(a.view(), b.view(), peak), ssim_by_definition(a, b, peak), 1e-9);
    }
}

TEST(Ssim, AMirroredSignalIsNegativelySimilar) {
  const Image a = random_image(64, 64, 3);
  Image b = a;
  for (float& v : b.values()) v = 1 - v;
  EXPECT_LT(*ssim(a.view(), b.view(), 1), -0.8);
}

TEST(Ssim, WindowsWithBrokenPixelsAreLeftOut) {
  Image a = random_image(24, 11, 4), b = random_image(24, 11, 5);
  // Windows are centred on rows 5 to 18; a broken pixel in the last row spoils only the last one.
  const double without = *ssim(a.view().window(0, 0, 23, 11), b.view().window(0, 0, 23, 11), 1);
  b(23, 4) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_NEAR(*ssim(a.view(), b.view(), 1), without, 1e-12);
  EXPECT_FALSE(ssim(Image(10, 50).view(), Image(10, 50).view(), 1).decided());
}

TEST(Ssim, TheSameForAnyNumberOfThreads) {
  const Planes a = one_plane(random_image(150, 90, 6)), b = one_plane(random_image(150, 90, 7));
  set_thread_count(1);
  const double one = *ssim(a, b, 1), psnr_one = *psnr_db(a, b, 1);
  set_thread_count(3);
  EXPECT_EQ(*ssim(a, b, 1), one);
  EXPECT_EQ(*psnr_db(a, b, 1), psnr_one);
  set_thread_count(0);
}

}  // namespace
}  // namespace malus
