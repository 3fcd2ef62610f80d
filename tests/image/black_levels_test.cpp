#include "malus/image/black_levels.h"

#include "malus/base/error.h"

#include <limits>

#include "problem_of.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using Blacks = std::vector<double>;

TEST(BlackLevels, OneServesAllAndOthersAreCounted) {
  const SensorLayout bayer = SensorLayout::named("bayer-rggb");
  EXPECT_EQ(black_per_channel({64}, bayer, "x"), Blacks(4, 64));
  EXPECT_EQ(black_per_channel({1, 2, 3, 4}, bayer, "x"), (Blacks{1, 2, 3, 4}));
  EXPECT_THROW(black_per_channel({1, 2, 3}, bayer, "x"), InputError);
}

TEST(BlackLevels, PositionsKeepTheirsUnderAnotherLayout) {
  RawFrame frame;
  frame.layout = SensorLayout::named("bayer-rggb");
  frame.black_dn = {510, 514, 508, 512};
  EXPECT_EQ(blacks_for_layout(frame, frame.layout), frame.black_dn);
  EXPECT_EQ(
      blacks_for_layout(frame, SensorLayout::named("polar-bayer-rggb")),
      (Blacks{510, 514, 510, 514, 508, 512, 508, 512, 510, 514, 510, 514, 508, 512, 508, 512}));
  EXPECT_THROW(blacks_for_layout(frame, SensorLayout()), InputError);
  frame.black_dn = {512, 512, 512, 512};
  EXPECT_EQ(blacks_for_layout(frame, SensorLayout()), Blacks{512});
}

RawFrame dark_frame(float level_dn) {
  RawFrame frame;
  frame.layout = SensorLayout::named("polar-mono");
  frame.source = "dark.png";
  frame.bits = 12;
  frame.white_dn = 4095;
  frame.dn = Image(4, 6);
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 6; ++c)
      frame.dn(r, c) = level_dn + static_cast<float>(10 * frame.layout.channel_at(r, c));
  return frame;
}

TEST(DarkLevels, AreTheMeansOfEveryChannelOverTheFrames) {
  DarkLevels levels;
  RawFrame first = dark_frame(76);
  first.dn(0, 0) += 3;
  first.dn(0, 2) = std::numeric_limits<float>::quiet_NaN();
  first.dn(0, 4) -= 3;
  levels.add(first);
  levels.add(dark_frame(78));
  EXPECT_EQ(levels.black_dn(), (Blacks{77, 87, 97, 107}));
}

TEST(DarkLevels, RefuseWhatIsNotDark) {
  DarkLevels levels;
  levels.add(dark_frame(80));
  const auto refused = [&](const RawFrame& frame) {
    return testing::problem_of([&] { levels.add(frame); });
  };
  EXPECT_NE(refused(dark_frame(1100)).find("dark.png: its mean, 1100 DN"), std::string::npos);
  RawFrame other = dark_frame(80);
  other.layout = SensorLayout();
  EXPECT_NE(refused(other).find("another layout"), std::string::npos);
  RawFrame none = dark_frame(80);
  for (float& dn : none.dn.values()) dn = std::numeric_limits<float>::quiet_NaN();
  EXPECT_NE(refused(none), "");
  RawFrame louder = dark_frame(80);
  louder.gain.gain_db = 24;
  EXPECT_EQ(refused(louder), "");  // the first that tells its gain
  louder.gain.gain_db = 0;
  EXPECT_NE(refused(louder).find("was taken at 0 dB, the dark frames before it at 24 dB"),
            std::string::npos);
  EXPECT_EQ(levels.gain().text(), "24 dB");
  RawFrame floats = dark_frame(1100);  // whose white is a guess
  floats.bits = 0;
  EXPECT_EQ(refused(floats), "");
}

}  // namespace
}  // namespace malus
