#include "malus/report/internal/colors.h"

#include <cmath>
#include <set>

#include <gtest/gtest.h>

namespace malus {
namespace {

// Relative luminance of sRGB (IEC 61966-2-1, Rec. 709 weights).
double luminance(const PaletteColor& color) {
  const auto linear = [](double v) {
    v /= 255;
    return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
  };
  return 0.2126 * linear(color[0]) + 0.7152 * linear(color[1]) + 0.0722 * linear(color[2]);
}

TEST(Palettes, LightnessRisesInTheOrderedOnes) {
  for (const Palette palette : {Palette::kGrey, Palette::kSequential})
    for (int i = 4; i < 64; ++i)  // the darkest greys share 8-bit values
      EXPECT_LT(luminance(palette_color(palette, i / 64.0)),
                luminance(palette_color(palette, (i + 1) / 64.0)))
          << i;
}

TEST(Palettes, DivergingIsLightestInTheMiddleAndItsEndsDiffer) {
  const double middle = luminance(palette_color(Palette::kDiverging, 0.5));
  EXPECT_GT(middle, luminance(palette_color(Palette::kDiverging, 0.2)));
  EXPECT_GT(middle, luminance(palette_color(Palette::kDiverging, 0.8)));
  const PaletteColor low = palette_color(Palette::kDiverging, 0),
                     high = palette_color(Palette::kDiverging, 1);
  EXPECT_GT(low[2], low[0]);    // blue
  EXPECT_GT(high[0], high[2]);  // orange
}

TEST(Palettes, CyclicOneCloses) {
  EXPECT_EQ(palette_color(Palette::kCyclic, 0), palette_color(Palette::kCyclic, 1));
}

TEST(Tones, FilterGivesTheColourAndAngleTheSymbol) {
  EXPECT_EQ(tone_of("G1_45", 3).symbol, Symbol::kTriangle);
  EXPECT_EQ(tone_of("G1_45", 0).color, tone_of("G1_90", 5).color);
  EXPECT_NE(tone_of("G1_0", 0).color, tone_of("G2_0", 0).color);
  EXPECT_NE(tone_of("R0", 0).color, tone_of("B0", 0).color);
  EXPECT_EQ(tone_of("135", 0).symbol, Symbol::kDiamond);
  std::set<std::string> angles;
  for (const char* angle : {"0", "45", "90", "135"}) angles.insert(tone_of(angle, 0).color);
  EXPECT_EQ(angles.size(), 4U);
  EXPECT_EQ(tone_of("", 2).color, series_colors()[2]);
}

}  // namespace
}  // namespace malus
