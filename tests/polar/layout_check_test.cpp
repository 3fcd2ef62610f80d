#include "malus/polar/layout_check.h"

#include "malus/base/random.h"
#include "malus/polar/stokes.h"

#include <gtest/gtest.h>

namespace malus {
namespace {

// A scene whose polarization turns slowly over the picture, mosaicked with a layout.
Image polarized_mosaic(const SensorLayout& layout, int rows, int cols, double dolp,
                       double noise_sd) {
  Image mosaic(rows, cols);
  RandomSequence random(7, 0, Draw::kOther);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const double twice = 0.02 * r + 0.013 * c, s0 = 400 + 2.0 * c;
      const Stokes s{s0, dolp * s0 * std::cos(twice), dolp * s0 * std::sin(twice)};
      const int angle = *layout.site(layout.channel_at(r, c)).angle_deg;
      mosaic(r, c) = static_cast<float>(intensity_behind(s, angle) + noise_sd * random.normal());
    }
  return mosaic;
}

TEST(LayoutCheck, ScoresOfOneBlockAreTheClosedForm) {
  Image block(2, 2);
  block(0, 0) = 1, block(0, 1) = 2, block(1, 0) = 4, block(1, 1) = 9;  // S0 = 8
  const LayoutCheck check = check_layout(block);
  EXPECT_EQ(check.blocks, 1);
  EXPECT_DOUBLE_EQ(check.diagonal, 4.0 / 8);
  EXPECT_DOUBLE_EQ(check.row, 10.0 / 8);
  EXPECT_DOUBLE_EQ(check.column, 6.0 / 8);
  EXPECT_EQ(check.winner(), Pairing::kDiagonal);
  EXPECT_DOUBLE_EQ(check.margin(), 1.5);
  EXPECT_FALSE(check.decided()) << "one block decides nothing";
}

// Every registered polarization layout, and cells with the pairs on rows and columns, are found.
TEST(LayoutCheck, FindsThePairingOfEveryLayout) {
  std::vector<SensorLayout> layouts;
  for (const auto& name : SensorLayout::known_names())
    if (SensorLayout::named(name).polarized()) layouts.push_back(SensorLayout::named(name));
  ASSERT_EQ(layouts.size(), 5u);
  layouts.push_back(SensorLayout::from_sites({{"0", "45"}, {"135", "90"}}));
  layouts.push_back(SensorLayout::from_sites({{"0", "90"}, {"45", "135"}}));
  layouts.push_back(SensorLayout::from_sites({{"0", "45"}, {"90", "135"}}));
  for (const auto& layout : layouts) {
    const auto declared = declared_pairing(layout);
    ASSERT_TRUE(declared) << layout.name();
    const auto check = check_layout(polarized_mosaic(layout, 64, 96, 0.3, 5));
    EXPECT_TRUE(check.decided()) << layout.name();
    EXPECT_EQ(check.winner(), *declared) << layout.name();
    EXPECT_EQ(layout_complaint(layout, check), "");
  }
}

TEST(LayoutCheck, ComplainsAboutTheWrongLayoutOnly) {
  const auto rows = SensorLayout::from_sites({{"0", "90"}, {"45", "135"}});
  const auto check = check_layout(polarized_mosaic(rows, 64, 96, 0.3, 5));
  EXPECT_EQ(layout_complaint(rows, check), "");
  EXPECT_NE(layout_complaint(SensorLayout::named("polar-mono"), check).find("row"),
            std::string::npos);
  EXPECT_EQ(layout_complaint(SensorLayout::named("bayer-rggb"), check), "");
}

TEST(LayoutCheck, UnpolarizedNoiseStaysUndecided) {
  const auto check =
      check_layout(polarized_mosaic(SensorLayout::named("polar-mono"), 256, 256, 0, 20));
  EXPECT_FALSE(check.decided()) << check.margin();
}

TEST(LayoutCheck, DecidesFromItsMarginAndItsBlocksOn) {
  const auto decided = [](double second, std::int64_t blocks) {
    return LayoutCheck{.diagonal = 0.1, .row = 0.3, .column = 0.1 * second, .blocks = blocks}
        .decided();
  };
  EXPECT_TRUE(decided(1.16, 256));
  EXPECT_FALSE(decided(1.14, 256));
  EXPECT_FALSE(decided(1.16, 255));
}

TEST(LayoutCheck, DarkAndBrokenBlocksAreLeftOut) {
  Image mosaic(2, 9, 1.0f);  // the odd column belongs to no block
  mosaic(0, 0) = std::numeric_limits<float>::quiet_NaN();
  mosaic(0, 2) = -3;
  mosaic(0, 4) = std::numeric_limits<float>::infinity();
  EXPECT_EQ(check_layout(mosaic).blocks, 1);
  EXPECT_EQ(check_layout(Image(1, 1)).blocks, 0);
  EXPECT_FALSE(check_layout(Image(1, 1)).decided());
}

TEST(LayoutCheck, LayoutsWithoutFourAnglesInABlockDeclareNothing) {
  EXPECT_FALSE(declared_pairing(SensorLayout::named("mono")));
  EXPECT_FALSE(declared_pairing(SensorLayout::named("bayer-rggb")));
  EXPECT_FALSE(declared_pairing(SensorLayout::from_sites({{"0", "0"}, {"45", "135"}})));
}

}  // namespace
}  // namespace malus
