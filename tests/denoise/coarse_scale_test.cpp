// Truth: means and straight lines worked out by hand.
#include "malus/denoise/internal/coarse_scale.h"

#include "malus/base/progress.h"
#include "malus/denoise/denoiser.h"
#include "malus/noise/model.h"

#include <cmath>
#include <vector>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// Every channel has a level and a slope of its own.
Image ramp(const SensorLayout& layout, int rows, int cols, double slope) {
  Image image(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      image(r, c) = static_cast<float>(10 * layout.channel_at(r, c) + slope * (r / layout.rows()) +
                                       0.5 * slope * layout.channel_at(r, c) * (c / layout.cols()));
  return image;
}

TEST(CoarseScale, IsTwiceTheMeanOfFourPeriods) {
  const SensorLayout layout = SensorLayout::named("polar-mono");
  Image fine(8, 12);
  for (int r = 0; r < 8; ++r)
    for (int c = 0; c < 12; ++c) fine(r, c) = static_cast<float>(100 * r + c);
  const Image coarse = internal::coarse_frame(source_of(fine, layout));
  ASSERT_EQ(coarse.rows(), 4);
  ASSERT_EQ(coarse.cols(), 6);
  // Rows 1 and 3, columns 4 and 6; then rows 4 and 6, columns 9 and 11.
  EXPECT_FLOAT_EQ(coarse(1, 2), 0.5f * (104 + 106 + 304 + 306));
  EXPECT_FLOAT_EQ(coarse(2, 5), 0.5f * (409 + 411 + 609 + 611));
}

TEST(CoarseScale, OddSizesKeepEveryChannel) {
  const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  Image fine(70, 73);
  for (int r = 0; r < 70; ++r)
    for (int c = 0; c < 73; ++c) fine(r, c) = static_cast<float>(layout.channel_at(r, c));
  const Image coarse = internal::coarse_frame(source_of(fine, layout));
  // A last single period would have the noise of one sample, not of four.
  ASSERT_EQ(coarse.rows(), 32);
  ASSERT_EQ(coarse.cols(), 36);
  for (int r = 0; r < coarse.rows(); ++r)
    for (int c = 0; c < coarse.cols(); ++c)
      ASSERT_EQ(coarse(r, c), 2.0f * static_cast<float>(layout.channel_at(r, c))) << r << ' ' << c;
}

TEST(CoarseScale, CorrectionReplacesStraightLines) {
  for (const char* name : {"mono", "bayer-rggb", "polar-mono", "polar-bayer-rggb"}) {
    const SensorLayout layout = SensorLayout::named(name);
    const int rows = 24 * layout.rows(), cols = 32 * layout.cols();
    const Image truth = ramp(layout, rows, cols, 0.3);
    const Image coarse = internal::coarse_frame(source_of(truth, layout));
    Image estimate = ramp(layout, rows, cols, 0.25);
    internal::correct_low_frequencies(estimate, coarse, layout);
    // Straight lines pass the smoothing and the interpolation unchanged, but for the border.
    for (int r = 4 * layout.rows(); r < rows - 4 * layout.rows(); ++r)
      for (int c = 4 * layout.cols(); c < cols - 4 * layout.cols(); ++c)
        ASSERT_NEAR(estimate(r, c), truth(r, c), 1e-3) << name << ' ' << r << ' ' << c;
  }
}

TEST(CoarseScale, FineDetailIsLeftAlone) {
  const SensorLayout layout = SensorLayout::named("mono");
  Image estimate(64, 64);
  for (int r = 0; r < 64; ++r)
    for (int c = 0; c < 64; ++c) estimate(r, c) = (r + c) % 2 ? 5.0f : -5.0f;
  const Image before = estimate;
  internal::correct_low_frequencies(estimate, Image(32, 32), layout);
  EXPECT_EQ(estimate.values(), before.values());
}

PhysicsNoise dim_light_camera() {
  PhysicsChannel channel;
  channel.gain_dn_per_e = 0.4;
  channel.sigma_tl_dn = 1;
  return equal_channels("polar-bayer-rggb", channel);
}

// Without a coarse scale means of channels moved by up to half of light of 0.6 electrons.
TEST(CoarseScale, KeepsTheMeansOfDimEvenLightInEveryProfile) {
  const PhysicsNoise noise = dim_light_camera();
  constexpr int kSize = 192;
  constexpr float kLight_dn = 0.24f;
  constexpr auto kChannels = 16;
  for (const char* profile : {"fast", "normal"})
    for (const std::uint64_t seed : {1, 2, 3}) {
      const RawFrame frame =
          drawn_frame(Image(kSize, kSize, kLight_dn), noise, {.black_dn = 64}, seed);
      const Denoised result = denoise_frame(frame, profile_of(noise), {.profile = profile});
      std::vector<double> moved(kChannels);
      for (int r = 0; r < kSize; ++r)
        for (int c = 0; c < kSize; ++c)
          moved[static_cast<std::size_t>(frame.layout.channel_at(r, c))] +=
              (double{result.dn_above_black(r, c)} - (double{frame.dn(r, c)} - 64)) /
              (kSize * kSize / kChannels);
      for (const double shift_dn : moved) EXPECT_LT(std::abs(shift_dn), 0.06) << profile << seed;
    }
}

// Planes of one channel have blocks that reach four times as far: 0.6 of the squared error of the
// mosaic without coarse scales.
TEST(CoarseScale, SlowSlopesComeOutOfFastNoWorseThanOfPlanesByBm3d) {
  const PhysicsNoise noise = dim_light_camera();
  constexpr int kSize = 192;
  Image slope(kSize, kSize);
  for (int r = 0; r < kSize; ++r)
    for (int c = 0; c < kSize; ++c) slope(r, c) = 60 + 0.1f * static_cast<float>(c + r);
  const RawFrame frame = drawn_frame(slope, noise, {.black_dn = 64}, 4);
  const auto square = [&](const DenoiseSettings& settings) {
    const Denoised result = denoise_frame(frame, profile_of(noise), settings);
    double sum = 0;
    for (std::size_t i = 0; i < slope.size(); ++i)
      sum += std::pow(double{result.dn_above_black.values()[i]} - double{slope.values()[i]}, 2);
    return sum;
  };
  EXPECT_LT(square({.profile = "fast"}), square({.method = "vst-pca-bm3d"}));
}

}  // namespace
}  // namespace malus
