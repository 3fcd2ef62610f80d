#include "malus/synthesize/light_scale.h"

#include <limits>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr double kWhite = 4000;

// From 0 to nearly `most`, more pixels than are looked at first.
Image rising_light(float most) {
  Image light(60, 50);
  for (std::size_t i = 0; i < light.size(); ++i)
    light.values()[i] = most * static_cast<float>(i) / static_cast<float>(light.size());
  return light;
}

TEST(LightScale, PicturesOfAnotherScaleAreTold) {
  EXPECT_NE(light_scale_complaint(rising_light(1), kWhite).find("brighter than 1 DN"),
            std::string::npos);
  EXPECT_NE(light_scale_complaint(rising_light(65535), kWhite).find("brighter than white, 4000 DN"),
            std::string::npos);
}

TEST(LightScale, LightOfTheCameraIsNot) {
  EXPECT_EQ(light_scale_complaint(rising_light(100), kWhite), "");
  EXPECT_EQ(light_scale_complaint(rising_light(4400), kWhite), "");  // a window in the sun
  EXPECT_EQ(light_scale_complaint(Image(8, 8), kWhite), "");         // dark frames
  EXPECT_EQ(light_scale_complaint(Image(8, 8, 0.5f), kWhite), "");   // evenly lit ones
  EXPECT_EQ(light_scale_complaint(Image(), kWhite), "");
  EXPECT_EQ(light_scale_complaint(rising_light(65535), 0), "");  // white that nobody told
}

// Floats have no white but 1; integers have that of their type, whatever is left of them.
TEST(PictureScale, FloatsThatAreNotFrom0To1AreTold) {
  const auto told = [](float most, int bits, double exposure) {
    Planes light(3, 0, 0);
    for (Image& plane : light) plane = rising_light(most);
    return picture_scale_complaint(light, bits, exposure);
  };
  EXPECT_NE(told(255, 0, 1).find("which is 1 of float pixels"), std::string::npos);
  EXPECT_NE(told(255, 0, 0.5), "");
  EXPECT_EQ(told(255, 0, 1.0 / 255), "");  // by which the scale is right
  EXPECT_EQ(told(1.1F, 0, 1), "");         // lamps
  EXPECT_EQ(told(1, 0, 4), "");            // too long an exposure is asked for
  EXPECT_EQ(told(255, 8, 1), "");
}

// A pixel that is none of those that are looked at first, in the dark, is found.
TEST(LightScale, OneStarIsLight) {
  Image sky = rising_light(1);
  sky(0, 1) = 300;
  EXPECT_EQ(light_scale_complaint(sky, kWhite), "");
  sky(0, 1) = std::numeric_limits<float>::infinity();
  EXPECT_NE(light_scale_complaint(sky, kWhite), "");
}

}  // namespace
}  // namespace malus
