#include "malus/polar/stokes.h"

#include "malus/base/random.h"
#include "malus/image/pack.h"

#include <gtest/gtest.h>

namespace malus {
namespace {

// Angles on a circle of 180 degrees.
double angle_distance_deg(double a, double b) {
  const double d = std::fmod(std::abs(a - b), 180.0);
  return std::min(d, 180.0 - d);
}

// A uniform scene behind every site of a layout.
Image uniform_mosaic(const SensorLayout& layout, int rows, int cols, const Stokes& s) {
  Image mosaic(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      mosaic(r, c) =
          static_cast<float>(intensity_behind(s, *layout.site(layout.channel_at(r, c)).angle_deg));
  return mosaic;
}

// Malus's law gives the intensities; Stokes, DoLP and AoLP have to come back.
TEST(Stokes, RecoversLightOfEveryDirection) {
  for (double angle_deg = 0; angle_deg < 180; angle_deg += 7.5)
    for (double dolp : {0.001, 0.3, 1.0}) {
      const double twice = 2 * angle_deg * std::numbers::pi / 180;
      const Stokes truth{50, 50 * dolp * std::cos(twice), 50 * dolp * std::sin(twice)};
      const Stokes s = stokes_of(intensity_behind(truth, 0), intensity_behind(truth, 45),
                                 intensity_behind(truth, 90), intensity_behind(truth, 135));
      EXPECT_NEAR(s.s0, truth.s0, 1e-12);
      EXPECT_NEAR(s.s1, truth.s1, 1e-12);
      EXPECT_NEAR(s.s2, truth.s2, 1e-12);
      EXPECT_NEAR(dolp_of(s), dolp, 1e-12);
      EXPECT_NEAR(angle_distance_deg(aolp_deg_of(s), angle_deg), 0, 1e-9);
      EXPECT_GE(aolp_deg_of(s), 0);
      EXPECT_LT(aolp_deg_of(s), 180);
    }
}

TEST(Stokes, TheCardinalAngles) {
  EXPECT_DOUBLE_EQ(aolp_deg_of({1, 1, 0}), 0);
  EXPECT_DOUBLE_EQ(aolp_deg_of({1, 0, 1}), 45);
  EXPECT_DOUBLE_EQ(aolp_deg_of({1, -1, 0}), 90);
  EXPECT_DOUBLE_EQ(aolp_deg_of({1, -1, -0.0}), 90);
  EXPECT_DOUBLE_EQ(aolp_deg_of({1, 0, -1}), 135);
}

TEST(Stokes, UndefinedIsNotANumberNeverZeroOrInfinite) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(dolp_of(Stokes{0, 1, 1})));
  EXPECT_TRUE(std::isnan(dolp_of(Stokes{-5, 1, 1})));
  EXPECT_TRUE(std::isnan(dolp_of(Stokes{nan, 1, 1})));
  EXPECT_TRUE(std::isnan(aolp_deg_of(Stokes{-5, 1, 1})));
  EXPECT_TRUE(std::isnan(aolp_deg_of(Stokes{5, 0, 0})));
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(std::isnan(aolp_deg_of(stokes_of(1, 1, infinity, 1))));
  EXPECT_DOUBLE_EQ(dolp_of(Stokes{5, 0, 0}), 0);
}

TEST(Stokes, AnglePlanesStayBelow180AfterRounding) {
  StokesPlanes s{Image(1, 1, 1.0f), Image(1, 1, 1.0f), Image(1, 1, -1e-9f)};
  const float angle = aolp_deg_of(s)(0, 0);
  EXPECT_GE(angle, 0.0f);
  EXPECT_LT(angle, 180.0f);
}

TEST(StokesPerColor, EveryPolarizationLayoutGivesTheSameAnswer) {
  const Stokes truth{200, -60, 90};
  for (const auto& name : SensorLayout::known_names()) {
    const auto layout = SensorLayout::named(name);
    if (!layout.polarized()) continue;
    const auto per_color =
        stokes_per_color(pack(uniform_mosaic(layout, 9, 13, truth), layout), layout);
    ASSERT_EQ(per_color.size(), layout.colors().size());
    for (const auto& s : per_color)
      for (std::size_t i = 0; i < s.s0.size(); ++i) {
        EXPECT_NEAR(s.s0.values()[i], 200, 1e-4);
        EXPECT_NEAR(s.s1.values()[i], -60, 1e-4);
        EXPECT_NEAR(s.s2.values()[i], 90, 1e-4);
      }
  }
}

// Mirror-handed data read as Sony's [90 45; 135 0]: [90 135; 45 0] negates S2 (AoLP -> -AoLP), and
// [0 45; 135 90] negates S1 (AoLP -> 90 - AoLP, the same mirror turned by 90 degrees). The layout
// check cannot see either; the custom cell puts both right.
TEST(StokesPerColor, HandednessIsFixedByACustomCell) {
  const Stokes truth{100, 30, 20};
  const auto sony = SensorLayout::named("polar-mono");
  const auto wrong_and_right = [&](const SensorLayout& camera) {
    const Image mosaic = uniform_mosaic(camera, 8, 8, truth);
    const auto as_sony = stokes_per_color(pack(mosaic, sony), sony)[0];
    const auto as_cell = stokes_per_color(pack(mosaic, camera), camera)[0];
    return std::pair{Stokes{as_sony.s0(1, 1), as_sony.s1(1, 1), as_sony.s2(1, 1)},
                     Stokes{as_cell.s0(1, 1), as_cell.s1(1, 1), as_cell.s2(1, 1)}};
  };
  const auto [sony_on_a, cell_on_a] =
      wrong_and_right(SensorLayout::from_sites({{"90", "135"}, {"45", "0"}}));
  EXPECT_NEAR(sony_on_a.s1, 30, 1e-4);
  EXPECT_NEAR(sony_on_a.s2, -20, 1e-4) << "S2 negated";
  EXPECT_NEAR(cell_on_a.s2, 20, 1e-4);
  const auto [sony_on_b, cell_on_b] =
      wrong_and_right(SensorLayout::from_sites({{"0", "45"}, {"135", "90"}}));
  EXPECT_NEAR(sony_on_b.s1, -30, 1e-4) << "S1 negated";
  EXPECT_NEAR(sony_on_b.s2, 20, 1e-4);
  EXPECT_NEAR(cell_on_b.s1, 30, 1e-4);
}

TEST(StokesPerColor, RepeatedSitesAreAveraged) {
  const auto layout =
      SensorLayout::from_sites({{"0", "45", "0", "45"}, {"135", "90", "135", "90"}});
  Planes packed(8, 1, 1);
  const float values[8] = {10, 1, 14, 3, 5, 2, 7, 6};
  for (int k = 0; k < 8; ++k) packed[k](0, 0) = values[k];
  const auto s = stokes_per_color(packed, layout)[0];
  EXPECT_FLOAT_EQ(s.s1(0, 0), 12 - 4);
  EXPECT_FLOAT_EQ(s.s2(0, 0), 2 - 6);
}

TEST(StokesPerColor, LayoutsWithoutAnglesAreRefused) {
  for (const auto* name : {"mono", "bayer-rggb"}) {
    const auto layout = SensorLayout::named(name);
    EXPECT_THROW(stokes_per_color(Planes(layout.channels(), 2, 2), layout), InputError);
  }
}

TEST(MergeGreens, GreenIsTheMeanOfBothAndOrderIsRgb) {
  const auto layout = SensorLayout::named("polar-bayer-bggr");
  std::vector<StokesPlanes> per_color;
  for (int i = 0; i < 4; ++i)
    per_color.push_back(
        {Image(1, 1, static_cast<float>(i)), Image(1, 1, static_cast<float>(10 * i)), Image(1, 1)});
  const auto picture = merge_greens(std::move(per_color), layout);
  EXPECT_EQ(picture.names, (std::vector<std::string>{"R", "G", "B"}));
  EXPECT_FLOAT_EQ(picture.planes[0].s0(0, 0), 0.0f);
  EXPECT_FLOAT_EQ(picture.planes[1].s0(0, 0), 1.5f);
  EXPECT_FLOAT_EQ(picture.planes[1].s1(0, 0), 15.0f);
  EXPECT_FLOAT_EQ(picture.planes[2].s0(0, 0), 3.0f);
}

}  // namespace
}  // namespace malus
