#include "malus/image/frame_statistics.h"

#include "malus/base/random.h"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

namespace malus {
namespace {

RawFrame noisy_frame(const std::string& layout, int rows, int cols, double sigma,
                     bool rounded = false) {
  RawFrame frame;
  frame.layout = SensorLayout::named(layout);
  frame.black_dn.assign(static_cast<std::size_t>(frame.layout.channels()), 50.0);
  frame.white_dn = 4095;
  frame.bits = 12;
  frame.dn = Image(rows, cols);
  RandomSequence random(7, 0, Draw::kOther);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const int channel = frame.layout.channel_at(r, c);
      // Channels differ much in level, a little in noise; a slope lies over all.
      double value = 200.0 + 300.0 * channel + 0.05 * r + 0.03 * c +
                     sigma * (1.0 + 0.1 * channel) * random.normal();
      if (rounded) value = std::nearbyint(value);
      frame.dn(r, c) = static_cast<float>(value);
    }
  return frame;
}

// 128x128 pixels per channel: 4608 responses of 9-fold overlap; the error of the guess is near 2 %.
TEST(NoiseGuess, FindsTheNoiseOfEveryChannel) {
  const RawFrame frame = noisy_frame("polar-mono", 256, 256, 4.0);
  const auto channels = summarize(frame);
  ASSERT_EQ(channels.size(), 4u);
  for (int k = 0; k < 4; ++k) {
    const double truth = 4.0 * (1.0 + 0.1 * k);
    ASSERT_TRUE(channels[static_cast<std::size_t>(k)].noise_dn.decided());
    EXPECT_NEAR(*channels[static_cast<std::size_t>(k)].noise_dn, truth, 0.08 * truth);
    EXPECT_NEAR(channels[static_cast<std::size_t>(k)].mean_dn, 200 + 300 * k + 0.08 * 128, 0.5);
    EXPECT_EQ(channels[static_cast<std::size_t>(k)].pixels, 128 * 128);
  }
}

TEST(NoiseGuess, CoarseStepsDoNotSnapIt) {
  for (const double sigma : {0.6, 0.75, 0.9, 1.1}) {
    const RawFrame frame = noisy_frame("mono", 256, 256, sigma, true);
    const double truth = std::sqrt(sigma * sigma + 1.0 / 12.0);
    EXPECT_NEAR(summarize(frame)[0].noise_dn.value(), truth, 0.06 * truth) << sigma;
  }
}

TEST(NoiseGuess, TextureInHalfOfTheFrameDoesNotRaiseIt) {
  RawFrame frame = noisy_frame("mono", 256, 256, 3.0);
  for (int r = 0; r < 256; ++r)
    for (int c = 0; c < 128; ++c)
      frame.dn(r, c) += static_cast<float>(300.0 * std::sin(0.9 * r + 0.3) * std::sin(0.7 * c));
  EXPECT_NEAR(summarize(frame)[0].noise_dn.value(), 3.0, 0.3);
}

// The dark half of the frame is even, the bright one is not: the noise is the dark one's.
TEST(NoiseGuess, SaysAtWhichLightItWasMeasured) {
  RawFrame frame = noisy_frame("mono", 256, 256, 3.0);
  for (int r = 0; r < 256; ++r)
    for (int c = 0; c < 128; ++c)
      frame.dn(r, c) += static_cast<float>(1000 + 300.0 * std::sin(0.9 * r) * std::sin(0.7 * c));
  const ChannelSummary summary = summarize(frame)[0];
  EXPECT_NEAR(summary.noise_at_dn, 200 + 0.05 * 128 + 0.03 * 192, 10);
  EXPECT_GT(summary.mean_dn, 600);
}

TEST(NoiseGuess, UndecidedWhereItCannotKnow) {
  RawFrame small = noisy_frame("mono", 16, 16, 3.0);
  EXPECT_FALSE(summarize(small)[0].noise_dn.decided());
  EXPECT_TRUE(std::isnan(summarize(small)[0].noise_at_dn));
  RawFrame flat = noisy_frame("mono", 128, 128, 0.0);
  std::fill(flat.dn.values().begin(), flat.dn.values().end(), 7.0f);
  EXPECT_FALSE(summarize(flat)[0].noise_dn.decided());
  std::fill(flat.dn.values().begin(), flat.dn.values().end(), 4095.0f);
  EXPECT_FALSE(summarize(flat)[0].noise_dn.decided());
  EXPECT_EQ(summarize(flat)[0].saturated_share, 1.0);
}

TEST(Summarize, CountsWhatIsNotANumberAndWhatIsOutside) {
  RawFrame frame = noisy_frame("mono", 10, 10, 0.0);
  std::fill(frame.dn.values().begin(), frame.dn.values().end(), 100.0f);
  frame.dn(0, 0) = std::numeric_limits<float>::quiet_NaN();
  frame.dn(0, 1) = std::numeric_limits<float>::infinity();
  frame.dn(0, 2) = 4095.0f;
  frame.dn(0, 3) = 49.0f;
  const ChannelSummary summary = summarize(frame)[0];
  EXPECT_EQ(summary.pixels, 100);
  EXPECT_EQ(summary.nonfinite, 2);
  EXPECT_DOUBLE_EQ(summary.saturated_share, 1.0 / 98);
  EXPECT_DOUBLE_EQ(summary.below_black_share, 1.0 / 98);
  EXPECT_DOUBLE_EQ(summary.mean_dn, (96 * 100.0 + 4095 + 49) / 98);
  EXPECT_EQ(summary.minimum_dn, 49);
  EXPECT_EQ(summary.maximum_dn, 4095);
}

TEST(Summarize, OddSizesCountEveryPixelOnce) {
  const RawFrame frame = noisy_frame("polar-bayer-rggb", 7, 9, 1.0);
  std::int64_t pixels = 0;
  for (const auto& channel : summarize(frame)) pixels += channel.pixels;
  EXPECT_EQ(pixels, 63);
}

TEST(ValueGrid, ExactAndLooseSteps) {
  Image image(64, 64);
  const auto fill = [&](auto&& value) {
    for (int i = 0; i < 64 * 64; ++i)
      image.values()[static_cast<std::size_t>(i)] = static_cast<float>(value(i));
  };
  const auto expect = [&](int step, int offset, int spread) {
    const auto grid = value_grid(image.view());
    ASSERT_TRUE(grid.decided());
    EXPECT_EQ(grid->step, step);
    EXPECT_EQ(grid->offset, offset);
    EXPECT_EQ(grid->spread, spread);
  };
  fill([](int i) { return i; });
  expect(1, 0, 0);
  fill([](int i) { return 16 * i; });
  expect(16, 0, 0);
  fill([](int i) { return 16 * i + 15; });
  expect(16, 15, 0);
  fill([](int i) { return 257 * (i % 256); });
  expect(257, 0, 0);
  fill([](int i) { return 16 * (i + 1) - i % 2; });  // 16 n and 16 n - 1
  expect(16, 15, 1);
  fill([](int i) { return i % 20; });  // small values are no grid
  expect(1, 0, 0);
  fill([](int) { return 5; });
  expect(0, 5, 0);
  fill([](int i) { return 0.5 * i; });
  EXPECT_FALSE(value_grid(image.view()).decided());
}

TEST(ConverterGuess, IsTheLeastThatHoldsTheData) {
  const auto expect = [](const std::optional<ConverterGuess>& guess, int bits, int white_dn) {
    ASSERT_TRUE(guess.has_value());
    EXPECT_EQ(guess->bits, bits);
    EXPECT_EQ(guess->white_dn, white_dn);
  };
  const ValueGrid every{1, 0, 0};
  expect(converter_guess(16, 0, every), 8, 255);
  expect(converter_guess(16, 255, every), 8, 255);
  expect(converter_guess(16, 256, every), 10, 1023);
  expect(converter_guess(16, 4095, every), 12, 4095);
  expect(converter_guess(16, 4096, every), 14, 16383);
  expect(converter_guess(12, 1000, every), 10, 1023);
  // Twelve bits in the upper part of sixteen; a loose grid's last code may be anywhere in its step.
  expect(converter_guess(16, 65520, {16, 0, 0}), 16, 65520);
  expect(converter_guess(16, 4000, {16, 15, 1}), 12, 4095);
  expect(converter_guess(16, 5, {0, 5, 0}), 8, 255);
}

TEST(ConverterGuess, NoneWhereTheDataTellNothing) {
  const ValueGrid every{1, 0, 0};
  EXPECT_FALSE(converter_guess(16, 20000, every).has_value());
  EXPECT_FALSE(converter_guess(12, 2000, every).has_value());
  EXPECT_FALSE(converter_guess(8, 16, {16, 0, 0}).has_value());
  EXPECT_FALSE(converter_guess(16, -1, every).has_value());
  EXPECT_FALSE(converter_guess(32, 201855, every).has_value());
  EXPECT_FALSE(converter_guess(32, 200000, {20, 0, 0}).has_value());
  EXPECT_FALSE(converter_guess(16, std::numeric_limits<double>::quiet_NaN(), every).has_value());
}

TEST(LevelComplaint, NamesTheLevelThatThePixelsContradict) {
  RawFrame frame = noisy_frame("polar-mono", 64, 64, 4.0);  // 200 to 1100 DN
  EXPECT_EQ(level_complaint(frame), "");
  frame.white_dn = 255;
  EXPECT_NE(level_complaint(frame).find("above the white level"), std::string::npos);
  frame.white_dn = 4096;
  EXPECT_NE(level_complaint(frame).find("12 bits"), std::string::npos);
  frame.white_dn = 4095;
  frame.black_dn.assign(4, 900.0);
  EXPECT_NE(level_complaint(frame).find("below the black level"), std::string::npos);
}

// A thousandth of 4096 pixels.
TEST(LevelComplaint, HotPixelsAboveWhiteAreFewOrTheWhiteIsWrong) {
  RawFrame frame = noisy_frame("mono", 64, 64, 4.0);
  frame.white_dn = 2047;
  std::fill_n(frame.dn.row(0), 4, 4095.0F);
  EXPECT_EQ(share_beyond_white(frame), 0);
  EXPECT_EQ(level_complaint(frame), "");
  frame.dn(0, 4) = 4095;
  EXPECT_EQ(share_beyond_white(frame), 5.0 / 4096);
  EXPECT_NE(level_complaint(frame).find("0.122 % of its pixels"), std::string::npos);
}

// Dark frames scatter about black, float frames have no bits, and nobody knows NaN's level.
TEST(LevelComplaint, DarkAndFloatFramesAreFine) {
  RawFrame frame = noisy_frame("mono", 64, 64, 30.0);
  for (float& value : frame.dn.values()) value -= 155;
  frame.dn(3, 4) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(level_complaint(frame), "");
  frame.bits = 0;
  frame.white_dn = 1e6;
  EXPECT_EQ(level_complaint(frame), "");
}

}  // namespace
}  // namespace malus
