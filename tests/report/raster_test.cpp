#include "malus/report/internal/raster.h"

#include <cmath>
#include <random>

#include "raster_reader.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::decode_raster;

// Poisson-Gaussian mosaics with the variance line that the scale is made for.
Planes noisy_planes(int channels, int rows, int cols, double slope, double offset) {
  std::mt19937 engine(7);
  std::normal_distribution<double> gauss;
  Planes planes(channels, rows, cols);
  for (int channel = 0; channel < channels; ++channel)
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        const double signal = 10.0 * c + 3.0 * r;
        planes[channel](r, c) =
            static_cast<float>(signal + std::sqrt(slope * signal + offset) * gauss(engine));
      }
  return planes;
}

TEST(Raster, ExactIntegersComeBackOnAnySize) {
  for (const auto& [rows, cols] : {std::pair{1, 1}, {1, 7}, {7, 1}, {2, 2}, {33, 18}}) {
    Planes planes = noisy_planes(3, rows, cols, 2, 9);
    for (Image& plane : planes)
      for (float& value : plane.values()) value = std::round(value);
    const std::vector<RasterScale> scales(3);
    const Planes back =
        decode_raster(encode_raster(planes, scales, false), rows, cols, scales, false);
    for (int channel = 0; channel < 3; ++channel)
      EXPECT_EQ(back[channel].values(), planes[channel].values()) << rows << "x" << cols;
  }
}

TEST(Raster, ErrorStaysWithinHalfAStepOfTheNoise) {
  const double slope = 1.6, offset = 16, step = 0.5;
  const Planes planes = noisy_planes(2, 40, 50, slope, offset);
  const std::vector<RasterScale> scales(2, {slope, offset, step});
  const Planes back = decode_raster(encode_raster(planes, scales, true), 40, 50, scales, true);
  for (int channel = 0; channel < 2; ++channel)
    for (std::size_t i = 0; i < planes[channel].size(); ++i) {
      const double value = static_cast<double>(planes[channel].values()[i]);
      const double error = std::abs(static_cast<double>(back[channel].values()[i]) - value);
      // Half a step of sigma at the upper end of the step, where the slope of the inverse is
      // largest.
      const double sigma = std::sqrt(slope * std::max(value, 0.0) + offset) + 0.5 * step * slope;
      EXPECT_LE(error, 0.5 * step * sigma + 1e-3);
    }
}

// Subtractive dither makes the error uniform whatever the signal: variance step²/12 and no
// correlation with a constant signal between two codes. Bounds: 5 standard errors of n = 160,000.
TEST(Raster, DitherMakesTheErrorUniform) {
  const double step = 1.0, n = 400.0 * 400.0;
  for (const float signal : {0.0F, 0.25F, 0.5F, 0.8F}) {
    Planes planes(1, 400, 400);
    planes[0] = Image(400, 400, signal);
    const std::vector<RasterScale> scales(1, {0, 1, step});
    const Planes back = decode_raster(encode_raster(planes, scales, true), 400, 400, scales, true);
    double sum = 0, squares = 0;
    for (const float value : back[0].values()) {
      const double error = static_cast<double>(value) - static_cast<double>(signal);
      sum += error;
      squares += error * error;
    }
    EXPECT_NEAR(sum / n, 0, 5 * step / std::sqrt(12 * n) + step / 512) << signal;
    EXPECT_NEAR(squares / n, step * step / 12, 0.02 * step * step / 12) << signal;
  }
}

TEST(Raster, DitherDiffersBetweenChannels) {
  double product = 0;
  constexpr int kSide = 300;
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide; ++c)
      product += dither_256({0, r, c}) * dither_256({2, r, c}) / (256.0 * 256.0);
  // Correlation within 5 standard errors of zero: variance of a uniform variable is 1/12.
  EXPECT_LT(std::abs(product) * 12 / (kSide * kSide), 5.0 / kSide);
}

TEST(Raster, PixelsWithoutAValueStayWithoutOne) {
  Planes planes(1, 3, 3);
  planes[0](0, 0) = planes[0](1, 1) = NAN;
  planes[0](2, 2) = INFINITY;
  planes[0](1, 2) = 12;
  for (const bool dithered : {false, true}) {
    const std::vector<RasterScale> scales(1, {0, 1, 0.25});
    const Planes back =
        decode_raster(encode_raster(planes, scales, dithered), 3, 3, scales, dithered);
    EXPECT_TRUE(std::isnan(back[0](0, 0)));
    EXPECT_TRUE(std::isnan(back[0](1, 1)));
    EXPECT_TRUE(std::isnan(back[0](2, 2)));
    EXPECT_NEAR(back[0](1, 2), 12, 0.126);
    EXPECT_NEAR(back[0](0, 1), 0, 0.126);
  }
}

TEST(Raster, ValuesBeyondTheLargestCodeAreClamped) {
  EXPECT_EQ(raster_code(1e12, {}), 1'048'575);
  EXPECT_EQ(raster_code(-1e12, {}), -1'048'575);
}

TEST(Raster, NoiseCostsNearItsEntropy) {
  // White Gaussian noise in steps of half its deviation: log2(sqrt(2 pi e) / 0.5) = 3.05 bits, and
  // the prediction from four neighbours adds log2(sqrt(1.25)) = 0.16. Deflate's coding and the byte
  // boundary may add 10 %.
  std::mt19937 engine(3);
  std::normal_distribution<float> gauss;
  Planes planes(1, 512, 512);
  for (float& value : planes[0].values()) value = gauss(engine);
  const std::vector<RasterScale> scales(1, {0, 1, 0.5});
  const double bits =
      8.0 * static_cast<double>(encode_raster(planes, scales, true).size()) / (512.0 * 512.0);
  EXPECT_LT(bits, 1.1 * 3.21);
  EXPECT_GT(bits, 3.05);
}

TEST(Base64, IsRfc4648) {
  // The test vectors of RFC 4648, section 10.
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foo"), "Zm9v");
  EXPECT_EQ(base64("foob"), "Zm9vYg==");
  EXPECT_EQ(base64("fooba"), "Zm9vYmE=");
  EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
}

}  // namespace
}  // namespace malus
