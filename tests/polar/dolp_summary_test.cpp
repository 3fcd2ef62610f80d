#include "malus/polar/dolp_summary.h"

#include <limits>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

TEST(DolpSummary, NoiseAboveOneCountsAsOneAndDarknessNotAtAll) {
  Planes dolp(2, 1, 4);
  const float values[2][4] = {{0.25f, 1.0f, 40.0f, kNone}, {0.5f, 0.0f, kNone, kNone}};
  for (int k = 0; k < 2; ++k)
    for (int c = 0; c < 4; ++c) dolp[k](0, c) = values[k][c];
  const DolpSummary summary = summarize_dolp(dolp);
  ASSERT_TRUE(summary.mean.decided());
  EXPECT_DOUBLE_EQ(*summary.mean, (0.25 + 1 + 1 + 0.5 + 0) / 5);
  EXPECT_DOUBLE_EQ(summary.undefined, 3.0 / 8);
  EXPECT_DOUBLE_EQ(summary.aolp_undefined, 4.0 / 8) << "without polarization there is no angle";
  EXPECT_DOUBLE_EQ(summary.above_one, 1.0 / 8);
}

TEST(DolpSummary, WithoutLightTheMeanIsNotKnown) {
  Planes dolp(1, 1, 2);
  for (float& v : dolp[0].values()) v = kNone;
  const DolpSummary summary = summarize_dolp(dolp);
  EXPECT_FALSE(summary.mean.decided());
  EXPECT_EQ(summary.undefined, 1.0);
  EXPECT_EQ(summarize_dolp(Planes()).undefined, 0.0);
}

}  // namespace
}  // namespace malus
