#include "malus/image/black_levels.h"

#include "malus/base/error.h"

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

}  // namespace
}  // namespace malus
