// What a channel's whole numbers were multiplied by. Truth: the numbers are drawn and multiplied
// here.
#include "malus/image/digital_gain.h"

#include "malus/base/random.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

// Signals from 100 to 100 + range, noise of this deviation, rounded, times the gain, above 64.
std::vector<float> multiplied(double gain, double range, double noise, int pixels) {
  std::vector<float> out;
  RandomSequence random(1, 0, Draw::kOther);
  for (int i = 0; i < pixels; ++i) {
    const double code = std::round(100 + range * random.uniform() + noise * random.normal());
    out.push_back(static_cast<float>(64 + std::round(gain * code)));
  }
  return out;
}

TEST(DigitalGain, IsTheDistanceOfTheCodesInUse) {
  for (const double gain : {1.05, 1.1, 1.37, 1.5, 1.9, 2.0, 3.3, 8.0})
    for (const double range : {0.0, 1000.0})
      EXPECT_NEAR(digital_gain(multiplied(gain, range, 12, 100000), 1), gain, 0.02 * gain)
          << gain << " " << range;
}

TEST(DigitalGain, IsOneWhereAllCodesAreInUse) {
  for (const double range : {0.0, 50.0, 1000.0, 60000.0})
    for (const double noise : {0.5, 3.0, 12.0})
      for (const int pixels : {1000, 4000, 100000})
        EXPECT_EQ(digital_gain(multiplied(1, range, noise, pixels), 1), 1)
            << range << " " << noise << " " << pixels;
}

// Too few pixels to use every code, two levels of narrow noise, no whole numbers.
TEST(DigitalGain, IsOneWhereNothingTells) {
  EXPECT_EQ(digital_gain(multiplied(2, 3000, 12, 3000), 1), 1);
  std::vector<float> levels = multiplied(1, 0, 0.5, 5000);
  for (std::size_t i = 0; i < levels.size(); i += 2) levels[i] += 60;
  EXPECT_EQ(digital_gain(levels, 1), 1);
  EXPECT_EQ(digital_gain(multiplied(2, 0, 12, 5000), 0), 1);
  EXPECT_EQ(digital_gain({}, 1), 1);
}

// Of codes that are multiples of 16, as 12 bits in the upper part of 16.
TEST(DigitalGain, CountsInSteps) {
  std::vector<float> pixels = multiplied(1.5, 0, 12, 100000);
  for (float& v : pixels) v *= 16;
  EXPECT_NEAR(digital_gain(pixels, 16), 1.5, 0.03);
}

}  // namespace
}  // namespace malus
