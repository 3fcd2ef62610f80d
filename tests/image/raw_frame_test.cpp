#include "malus/image/raw_frame.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

GainSetting iso(double value) { return {std::nullopt, value}; }
GainSetting decibel(double value) { return {value, std::nullopt}; }

TEST(GainSetting, ContradictsAnotherSettingInTheSameUnit) {
  EXPECT_TRUE(iso(400).contradicts(iso(500)));
  EXPECT_TRUE(decibel(12).contradicts(decibel(12.5)));
  EXPECT_FALSE(iso(400).contradicts(iso(404)));
  EXPECT_FALSE(decibel(12).contradicts(decibel(12.04)));
  EXPECT_FALSE(iso(400).contradicts(decibel(0)));
  EXPECT_FALSE(iso(400).contradicts({}));
  EXPECT_FALSE(GainSetting().contradicts(iso(400)));
}

TEST(GainSetting, AtDecibelUndoesDecibel) {
  EXPECT_EQ(GainSetting::at_decibel(12.5, false), decibel(12.5));
  EXPECT_NEAR(*GainSetting::at_decibel(20, true).iso, 1000, 1e-9);
  EXPECT_NEAR(*GainSetting::at_decibel(*iso(640).decibel(), true).iso, 640, 1e-9);
}

TEST(GainSetting, APrefixNamesNoGainOfACameraThatTellsNone) {
  EXPECT_EQ(gain_prefix(decibel(12)), "12 dB: ");
  EXPECT_EQ(gain_prefix(iso(400), "Gaussian"), "ISO 400, Gaussian: ");
  EXPECT_EQ(gain_prefix(GainSetting(), "Gaussian"), "Gaussian: ");
  EXPECT_EQ(gain_prefix(GainSetting()), "");
}

TEST(RawFrame, WhiteIsAGuessOfFloatsAndOfTypesThatNoCameraFills) {
  EXPECT_EQ(white_of_bits(12), 4095);
  EXPECT_EQ(white_of_bits(16), 65535);
  EXPECT_EQ(white_of_bits(0), std::nullopt);
  EXPECT_EQ(white_of_bits(24), std::nullopt);
  Image dn(1, 4);
  dn(0, 0) = 3, dn(0, 1) = 200, dn(0, 2) = std::nanf(""), dn(0, 3) = HUGE_VALF;
  EXPECT_EQ(assumed_white_dn(8, dn.view()), 255);
  EXPECT_EQ(assumed_white_dn(0, dn.view()), 200);
  EXPECT_EQ(assumed_white_dn(24, dn.view()), 200);
  dn(0, 3) = 3.4e38F;  // "no data", or all is of another scale
  EXPECT_EQ(assumed_white_dn(0, dn.view()), 200);
  dn(0, 0) = dn(0, 1) = 1e20F;
  EXPECT_EQ(assumed_white_dn(0, dn.view()), 3.4e38F);
  RawFrame frame;
  for (const int bits : {0, 24}) {
    frame.bits = bits;
    EXPECT_TRUE(white_is_guessed(frame));
  }
  frame.white_known = true;
  EXPECT_FALSE(white_is_guessed(frame));
  frame.white_known = false;
  frame.bits = 12;
  EXPECT_FALSE(white_is_guessed(frame));
}

TEST(RawFrame, WhiteAboveBlackIsWhatEveryChannelCanHold) {
  EXPECT_EQ(white_above_black(4000, {60, 70, 50, 60}), 3930);
  EXPECT_EQ(white_above_black(4000, {}), 4000);
  RawFrame frame;
  frame.dn = Image(2, 2, 100.0f);
  frame.layout = SensorLayout::named("polar-mono");
  frame.black_dn = {60, 70, 50, 60};
  frame.white_dn = 4000;
  subtract_black(frame);
  EXPECT_EQ(frame.white_dn, 3930);
  EXPECT_EQ(frame.dn(0, 1), 30);
  EXPECT_EQ(frame.black_dn, std::vector<double>(4, 0.0));
}

TEST(RawFrame, LightLiesWithinAHundredTimesWhite) {
  RawFrame frame;
  frame.layout = SensorLayout::named("polar-mono");
  frame.black_dn = {60, 70, 50, 60};
  frame.white_dn = 4070;
  const LightRange light = light_range(frame);
  EXPECT_TRUE(light.holds(50 - 400e3f) && light.holds(4070 + 400e3f));
  for (const float dn : {40 - 400e3f, 4080 + 400e3f, -3.4e38f, 1e20f, INFINITY, NAN})
    EXPECT_FALSE(light.holds(dn)) << dn;
}

// What cannot be judged is left to whoever needs a white.
TEST(RawFrame, AWhiteThatIsNotAboveBlackTellsNoLight) {
  for (const double white_dn : {60.0, 0.0, std::nan("")}) {
    RawFrame frame;
    frame.black_dn = {60};
    frame.white_dn = white_dn;
    EXPECT_TRUE(light_range(frame).holds(0) && light_range(frame).holds(-3.4e38f));
    EXPECT_FALSE(light_range(frame).holds(INFINITY) || light_range(frame).holds(NAN));
  }
}

}  // namespace
}  // namespace malus
