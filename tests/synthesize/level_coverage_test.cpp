#include "malus/synthesize/level_coverage.h"

#include <limits>

#include <gtest/gtest.h>

namespace malus {
namespace {

// Four channels up to 100, 200, 300, 400 DN.
std::vector<LevelRange> ranges(double darkest_dn, bool continued) {
  std::vector<LevelRange> all;
  for (const double brightest : {100.0, 200.0, 300.0, 400.0})
    all.push_back({darkest_dn, brightest, continued});
  return all;
}

TEST(LevelCoverage, CountsEveryChannelForItself) {
  const SensorLayout layout = SensorLayout::named("bayer-rggb");
  const Image signal(40, 60, 250.0F);
  const LevelCoverage even = level_coverage(layout, ranges(0, true), signal);
  EXPECT_EQ(even.pixels, 2400);
  EXPECT_EQ(even.above, 1200);
  EXPECT_EQ(even.below, 0);
  // A window whose first pixel is the brightest channel's.
  const LevelCoverage odd =
      level_coverage(layout, ranges(0, true), signal.view().window(0, 0, 1, 1), 1, 1);
  EXPECT_EQ(odd.above, 0);
  EXPECT_EQ(odd.pixels, 1);
}

TEST(LevelCoverage, NoLightIsNotTooDark) {
  const SensorLayout layout = SensorLayout::named("bayer-rggb");
  Image signal(4, 4, -30.0F);
  signal(0, 0) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(level_coverage(layout, ranges(-2, true), signal).complaint(), "");
  const LevelCoverage dark = level_coverage(layout, ranges(5, true), signal);
  EXPECT_EQ(dark.pixels, 15);
  EXPECT_EQ(dark.below, 15);
}

TEST(LevelCoverage, InfinityIsNoLight) {
  const SensorLayout layout = SensorLayout::named("bayer-rggb");
  Image signal(4, 4, std::numeric_limits<float>::infinity());
  signal(0, 0) = signal(1, 1) = 250.0F;
  signal(2, 2) = -std::numeric_limits<float>::infinity();
  const LevelCoverage found = level_coverage(layout, ranges(5, true), signal);
  EXPECT_EQ(found.pixels, 2);
  EXPECT_EQ(found.above, 1);
  EXPECT_EQ(found.below, 0);
}

TEST(LevelCoverage, SaysSharesAndWhatTheyGet) {
  const SensorLayout layout = SensorLayout::named("bayer-rggb");
  const auto said = [&](double darkest_dn, bool continued, float signal) {
    return level_coverage(layout, ranges(darkest_dn, continued), Image(8, 8, signal)).complaint();
  };
  EXPECT_EQ(said(0, true, 50.0F), "");
  EXPECT_NE(said(0, true, 250.0F).find("50 % of the pixels lie above"), std::string::npos);
  EXPECT_NE(said(0, true, 250.0F).find("(100 DN)"), std::string::npos);
  EXPECT_NE(said(0, true, 250.0F).find("widened"), std::string::npos);
  EXPECT_NE(said(0, false, 250.0F).find("too weak"), std::string::npos);
  EXPECT_NE(said(60, true, 50.0F).find("below its darkest level (60 DN)"), std::string::npos);
  LevelCoverage sum;
  sum.add(level_coverage(layout, ranges(0, true), Image(8, 8, 250.0F)));
  sum.add(level_coverage(layout, ranges(0, false), Image(8, 8, 50.0F)));
  EXPECT_EQ(sum.pixels, 128);
  EXPECT_EQ(sum.above, 32);
  EXPECT_FALSE(sum.range.continued);
}

}  // namespace
}  // namespace malus
