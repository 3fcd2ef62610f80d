// What a frame does not tell comes from its sensor's model.
#include "malus/noise/frame_levels.h"

#include "malus/base/error.h"

#include "support.h"

namespace malus {
namespace {

NoiseModel sensor() {
  NoiseModel model;
  model.layout = SensorLayout::named("bayer-rggb");
  model.black_dn = {80, 81, 82, 85};
  model.white_dn = 4095;
  return model;
}

RawFrame frame_of(int bits) {
  RawFrame frame;
  frame.dn = Image(8, 8, 100.0F);
  frame.layout = SensorLayout::named("bayer-rggb");
  frame.layout_known = true;
  frame.black_dn = {0, 0, 0, 0};
  frame.white_dn = 65535;
  frame.bits = bits;
  frame.source = "frame.tif";
  return frame;
}

TEST(LevelsOfModel, AreTakenWhereNothingIsKnown) {
  RawFrame frame = frame_of(16);
  EXPECT_EQ(take_levels_of_model(sensor(), frame), "");
  EXPECT_EQ(frame.black_dn, sensor().black_dn);
  EXPECT_EQ(frame.white_dn, 4095);
  EXPECT_TRUE(frame.black_known && frame.white_known);
}

TEST(LevelsOfModel, YieldToWhatIsKnown) {
  RawFrame frame = frame_of(16);
  frame.black_dn = {1, 2, 3, 4};
  frame.white_dn = 1023;
  frame.black_known = frame.white_known = true;
  EXPECT_EQ(take_levels_of_model(sensor(), frame), "");
  EXPECT_EQ(frame.black_dn, (std::vector<double>{1, 2, 3, 4}));
  EXPECT_EQ(frame.white_dn, 1023);
}

TEST(LevelsOfModel, FloatPixelsAreAboveBlackAndThatIsSaid) {
  RawFrame frame = frame_of(0);
  EXPECT_NE(take_levels_of_model(sensor(), frame).find("give black 82"), std::string::npos);
  EXPECT_EQ(frame.black_dn, (std::vector<double>{0, 0, 0, 0}));
  EXPECT_EQ(frame.white_dn, 4095 - 85);  // the highest black: all channels reach it
  NoiseModel black_free = sensor();
  black_free.black_dn = {0, 0, 0, 0};
  frame = frame_of(0);
  EXPECT_EQ(take_levels_of_model(black_free, frame), "");
  EXPECT_EQ(frame.white_dn, 4095);
}

TEST(LevelsOfModel, WhiteThatTheUserStatesHoldsTheBlackLevel) {
  for (const bool stated : {false, true}) {
    RawFrame frame = frame_of(0);
    frame.white_dn = 1023;
    frame.white_known = true;
    take_levels_of_model(sensor(), frame, stated);
    EXPECT_EQ(frame.white_dn, stated ? 1023 - 85 : 1023);
    frame = frame_of(16);
    frame.white_dn = 1023;
    frame.white_known = true;
    take_levels_of_model(sensor(), frame, stated);
    EXPECT_EQ(frame.white_dn, 1023);
  }
}

TEST(UntoldGain, IsSaidOfWhatIsAskedFor) {
  NoiseModel model = sensor();
  EXPECT_EQ(untold_gain_complaint(model, {{12.0, std::nullopt}}), "");
  model.gaussian.resize(1);
  const GainSetting low{0.0, std::nullopt}, high{12.0, std::nullopt};
  EXPECT_EQ(untold_gain_complaint(model, {{}}), "");
  EXPECT_EQ(untold_gain_complaint(model, {high}), "does not say its gain; it is taken for 12 dB");
  EXPECT_EQ(untold_gain_complaint(model, {low, high, low, {}}),
            "does not say its gain; it is taken for 0 dB and 12 dB");
  model.gaussian[0].gain = low;
  EXPECT_EQ(untold_gain_complaint(model, {high}), "");
}

TEST(LevelsOfModel, LayoutsAreTakenButNeverChanged) {
  RawFrame frame = frame_of(16);
  frame.layout = SensorLayout();
  frame.layout_known = false;
  frame.black_dn = {64};
  frame.black_known = true;
  take_levels_of_model(sensor(), frame);
  EXPECT_EQ(frame.layout, sensor().layout);
  EXPECT_EQ(frame.black_dn, (std::vector<double>{64, 64, 64, 64}));
  frame.layout = SensorLayout::named("bayer-bggr");
  EXPECT_THROW(take_levels_of_model(sensor(), frame), InputError);
}

TEST(LevelsOfModel, BlackHasToLieBelowWhite) {
  RawFrame frame = frame_of(16);
  frame.white_dn = 82;
  frame.white_known = true;
  EXPECT_THROW(take_levels_of_model(sensor(), frame), InputError);
}

}  // namespace
}  // namespace malus
