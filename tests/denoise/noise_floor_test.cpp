#include "malus/denoise/internal/noise_floor.h"

#include "malus/base/random.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include <gtest/gtest.h>

namespace malus {
namespace {

// Gaussian noise of variance 4 + signal/10 over a picture.
Image noisy(int rows, int cols, const std::function<double(int, int)>& picture) {
  Image dn(rows, cols);
  RandomSequence random(7, 0, Draw::kOther);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const double signal = picture(r, c);
      dn(r, c) = static_cast<float>(signal + std::sqrt(4 + 0.1 * signal) * random.normal());
    }
  return dn;
}

// Told `times` too much noise; of the ratios the mean, NaN where nothing is known.
double mean_ratio(const Image& dn, const std::string& layout_name, double times,
                  float saturated = 1e9F) {
  const SensorLayout layout = SensorLayout::named(layout_name);
  const auto channels = static_cast<std::size_t>(layout.channels());
  const std::vector<NoiseFloor> floors =
      noise_floor(dn, layout, std::vector(channels, VarianceCurve::affine(0.1 * times, 4 * times)),
                  std::vector(channels, saturated));
  double mean = 0;
  for (const NoiseFloor& floor : floors) mean += floor.ratio / static_cast<double>(floors.size());
  return floors.empty() ? std::numeric_limits<double>::quiet_NaN() : mean;
}

const char* const kLayouts[] = {"polar-bayer-rggb", "polar-mono", "bayer-rggb", "mono"};

TEST(NoiseFloor, OfASmoothPictureIsItsNoise) {
  const Image even = noisy(384, 400, [](int, int) { return 200.0; });
  const Image ramp = noisy(384, 400, [](int r, int c) { return 20.0 + 2.0 * c + 0.3 * r; });
  for (const std::string layout : kLayouts)
    for (const double times : {1.0, 30.0}) {
      EXPECT_NEAR(mean_ratio(even, layout, times) * times, 1.0, 0.06) << layout;
      EXPECT_NEAR(mean_ratio(ramp, layout, times) * times, 1.0, 0.06) << layout;
    }
}

// Beside an edge the surroundings are of other noise than a patch.
TEST(NoiseFloor, OfStripesIsTheirOwnNoise) {
  const Image stripes = noisy(320, 320, [](int r, int c) {
    return 480.0 + 450 * std::tanh(7 * std::sin(2 * M_PI * (0.97 * c + 0.24 * r) / 64));
  });
  for (const std::string layout : {"mono", "polar-mono"}) {
    const auto channels = static_cast<std::size_t>(SensorLayout::named(layout).channels());
    const std::vector<NoiseFloor> floors = noise_floor(
        stripes, SensorLayout::named(layout), std::vector(channels, VarianceCurve::affine(0.1, 4)),
        std::vector(channels, 1e9F));
    ASSERT_FALSE(floors.empty());
    for (const NoiseFloor& floor : floors)
      EXPECT_NEAR(floor.ratio, 1.0, 0.15) << layout << " at " << floor.signal_dn;
  }
}

// Where in the patch they lie goes with the brightness and the roughness around it, by a hundredth:
// patches that were chosen by these would have the same dark pixels.
TEST(NoiseFloor, OfNarrowStripesIsThatOfTheirMean) {
  for (const double period : {5.3, 12.0}) {
    const double slant = period < 10 ? 0.576 : 0.349;
    const Image stripes = noisy(320, 320, [&](int r, int c) {
      const double turns = (c * std::cos(slant) + r * std::sin(slant)) / period,
                   phase = turns - std::floor(turns);
      return 100 + 700 * std::clamp((std::abs(phase - 0.5) - 0.25) * period + 0.5, 0.0, 1.0);
    });
    for (const std::string layout : {"mono", "polar-mono", "bayer-rggb"}) {
      const double ratio = mean_ratio(stripes, layout, 1.0);
      EXPECT_GT(ratio, 0.75) << layout << ' ' << period;
      EXPECT_LT(ratio, 1.4) << layout << ' ' << period;
    }
  }
}

// 30 times the noise's variance in the differences of neighbours, and only a few per cent are left.
TEST(NoiseFloor, TextureThatNeighboursTellIsNotInIt) {
  const Image weave = noisy(512, 512, [](int r, int c) {
    return 400.0 + 200 * std::sin(2 * M_PI * r / 9.1) * std::sin(2 * M_PI * c / 7.3);
  });
  for (const std::string layout : kLayouts)
    EXPECT_NEAR(mean_ratio(weave, layout, 1.0), 1.0, 0.12) << layout;
}

// Of one brightness throughout: the smooth half has its own share of the patches, not its own
// level.
TEST(NoiseFloor, APartThatIsSmoothIsEnough) {
  RandomSequence grain(9, 0, Draw::kOther);
  const Image part = noisy(512, 512, [&](int, int c) {
    return c < 256 ? 300.0 : 300.0 + 12 * grain.normal();  // white: nothing tells it from noise
  });
  for (const std::string layout : kLayouts) {
    const double ratio = mean_ratio(part, layout, 1.0);
    EXPECT_GT(ratio, 0.9) << layout;
    EXPECT_LT(ratio, 2.0) << layout;  // 5.2 in the other half
  }
}

TEST(NoiseFloor, LevelsRiseWithTheSignal) {
  const Image ramp = noisy(768, 768, [](int, int c) { return 20.0 + 2.0 * c; });
  const SensorLayout layout = SensorLayout::named("bayer-rggb");
  // Told more read noise than there is.
  const std::vector<NoiseFloor> floors = noise_floor(
      ramp, layout, std::vector(4, VarianceCurve::affine(0.1, 12.0)), std::vector(4, 1e9F));
  ASSERT_GE(floors.size(), 4u);
  for (std::size_t i = 0; i < floors.size(); ++i) {
    const double signal = floors[i].signal_dn, truth = (4 + 0.1 * signal) / (12 + 0.1 * signal);
    EXPECT_NEAR(floors[i].ratio / truth, 1.0, 0.1) << signal;
    EXPECT_GT(floors[i].relative_error, 0.0);
    EXPECT_LT(floors[i].relative_error, 0.05);
    if (i > 0) {
      EXPECT_GT(signal, floors[i - 1].signal_dn);
    }
  }
}

TEST(NoiseFloor, PixelsThatDoNotCountAreLeftOut) {
  Image even = noisy(384, 400, [](int, int) { return 200.0; });
  for (int r = 0; r < 384; r += 37)
    for (int c = 0; c < 400; c += 41)
      even(r, c) = (r + c) % 2 ? std::numeric_limits<float>::quiet_NaN() : 4000.0F;
  EXPECT_NEAR(mean_ratio(even, "polar-mono", 1.0, 4000.0F), 1.0, 0.06);
}

// Three by three parts are looked at one by one. Wherever the only pixels of a frame lie that tell
// anything, they are found.
TEST(NoiseFloor, IsFoundInEveryPartOfTheFrame) {
  constexpr int kPart = 128;
  const Image even = noisy(3 * kPart, 3 * kPart, [](int, int) { return 200.0; });
  for (int part = 0; part < 9; ++part) {
    Image alone(3 * kPart, 3 * kPart, std::numeric_limits<float>::quiet_NaN());
    for (int r = part / 3 * kPart; r < (part / 3 + 1) * kPart; ++r)
      for (int c = part % 3 * kPart; c < (part % 3 + 1) * kPart; ++c) alone(r, c) = even(r, c);
    EXPECT_NEAR(mean_ratio(alone, "polar-mono", 1.0), 1.0, 0.2) << part;
  }
}

TEST(NoiseFloor, NothingIsSaidWhereNothingCanBeKnown) {
  const auto even = [](int, int) { return 200.0; };
  EXPECT_TRUE(std::isnan(mean_ratio(noisy(48, 48, even), "polar-bayer-rggb", 1.0)));
  EXPECT_TRUE(std::isnan(mean_ratio(noisy(3, 400, even), "polar-bayer-rggb", 1.0)));
  EXPECT_TRUE(std::isnan(mean_ratio(noisy(384, 400, even), "mono", 1.0, 50.0F)));
}

}  // namespace
}  // namespace malus
