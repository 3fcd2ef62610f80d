#include "malus/polar/render.h"

#include "malus/polar/color_map.h"
#include "malus/polar/legend.h"

#include <algorithm>

#include <gtest/gtest.h>

namespace malus {
namespace {

const float kNaN = std::numeric_limits<float>::quiet_NaN();

double distance(const Rgb& a, const Rgb& b) {
  return std::hypot(std::hypot(a.r - b.r, a.g - b.g), a.b - b.b);
}

// Relative luminance of an sRGB colour (IEC 61966-2-1), an oracle apart from OKLab.
double luminance(const Rgb& c) {
  const auto linear = [](double v) {
    v /= 255;
    return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
  };
  return 0.2126 * linear(c.r) + 0.7152 * linear(c.g) + 0.0722 * linear(c.b);
}

TEST(SrgbCurve, MeetsTheStandardsPoints) {
  EXPECT_DOUBLE_EQ(srgb_to_linear(0.0), 0.0);
  EXPECT_NEAR(srgb_to_linear(1.0), 1.0, 1e-12);
  EXPECT_NEAR(srgb_to_linear(0.5), 0.21404114, 1e-7);  // IEC 61966-2-1
  EXPECT_NEAR(srgb_to_linear(0.04045), 0.0031308, 1e-6);
  for (const double linear : {0.0, 0.002, 0.18, 1.0})
    EXPECT_NEAR(srgb_to_linear(static_cast<double>(srgb_of_linear(linear)) / 255), linear, 1e-6);
}

TEST(ColorMap, OkLabWhiteAndBlackAreSrgbWhiteAndBlack) {
  EXPECT_LT(distance(rgb_of_oklab(1, 0, 0), {255, 255, 255}), 0.1);
  EXPECT_LT(distance(rgb_of_oklab(0, 0, 0), {0, 0, 0}), 0.1);
}

TEST(ColorMap, TheWheelIsCyclicSmoothAndOfOneBrightness) {
  EXPECT_LT(distance(aolp_color(0), aolp_color(180)), 1e-3);
  EXPECT_LT(distance(aolp_color(-10), aolp_color(170)), 1e-3);
  double darkest = 1, brightest = 0;
  for (int a = 0; a < 180; ++a) {
    const Rgb color = aolp_color(a);
    EXPECT_LT(distance(color, aolp_color(a + 1)), 7) << a;
    darkest = std::min(darkest, luminance(color));
    brightest = std::max(brightest, luminance(color));
    for (float v : {color.r, color.g, color.b}) {  // inside the gamut: nothing was clipped
      EXPECT_GT(v, 0.0f) << a;
      EXPECT_LT(v, 255.0f) << a;
    }
  }
  EXPECT_LT(brightest / darkest, 1.3);
  for (int a = 0; a < 180; a += 45)
    for (int b = 0; b < a; b += 45) EXPECT_GT(distance(aolp_color(a), aolp_color(b)), 60);
}

TEST(ColorMap, RisingMapRisesAndTwoSidedMapIsBalanced) {
  for (int i = 0; i < 100; ++i)
    EXPECT_LT(luminance(rising_color(i / 100.0)), luminance(rising_color((i + 1) / 100.0))) << i;
  for (double x : {0.25, 0.5, 0.75, 1.0}) {
    EXPECT_LT(std::abs(luminance(two_sided_color(x)) - luminance(two_sided_color(-x))), 0.04) << x;
    EXPECT_GT(two_sided_color(x).r, two_sided_color(x).b);
    EXPECT_LT(two_sided_color(-x).r, two_sided_color(-x).b);
  }
}

Rgb at(const Planes& picture, int r, int c) {
  return {picture[0](r, c), picture[1](r, c), picture[2](r, c)};
}

StokesPlanes uniform(int rows, int cols, float s0, float s1, float s2) {
  return {Image(rows, cols, s0), Image(rows, cols, s1), Image(rows, cols, s2)};
}

TEST(Render, UndefinedPixelsShowThePatternInEveryPicture) {
  StokesPlanes s = uniform(40, 40, 10, 3, -4);
  s.s0(7, 9) = s.s1(7, 9) = s.s2(7, 9) = kNaN;
  const Image dolp = dolp_of(s), aolp = aolp_deg_of(s);
  const RenderSettings settings;
  const auto differences = render_s1_s2(s, settings);
  for (const Planes& picture : {render_s0({{""}, {s}}, settings), differences.s1, differences.s2,
                                render_dolp(dolp, settings), render_aolp(aolp, dolp, settings)}) {
    EXPECT_EQ(picture.channels(), 3);
    EXPECT_LT(distance(at(picture, 7, 9), undefined_color(7, 9)), 1e-3);
    EXPECT_GT(distance(at(picture, 7, 10), undefined_color(7, 10)), 20);
  }
}

TEST(Render, DolpAndAolpHaveTheirMapsColours) {
  const StokesPlanes s = uniform(32, 32, 10, 3, -4);
  RenderSettings settings;
  EXPECT_LT(distance(at(render_dolp(dolp_of(s), settings), 3, 3), rising_color(0.5)), 1);
  const double angle = aolp_deg_of(s)(0, 0);
  EXPECT_LT(
      distance(at(render_aolp(aolp_deg_of(s), dolp_of(s), settings), 3, 3), aolp_color(angle)), 1);
  settings.aolp_by_dolp = true;
  EXPECT_LT(
      distance(at(render_aolp(aolp_deg_of(s), dolp_of(s), settings), 3, 3), aolp_color(angle, 0.5)),
      1);
}

TEST(Render, WhiteBalanceMakesAGreySceneGrey) {
  const StokesPicture scene{
      {"R", "G", "B"},
      {uniform(8, 8, 50, 0, 0), uniform(8, 8, 100, 0, 0), uniform(8, 8, 30, 0, 0)}};
  RenderSettings settings;
  const Rgb grey = at(render_s0(scene, settings), 2, 2);
  EXPECT_NEAR(grey.r, grey.g, 0.01);
  EXPECT_NEAR(grey.b, grey.g, 0.01);
  settings.white_balance = false;
  const Rgb raw = at(render_s0(scene, settings), 2, 2);
  EXPECT_NEAR(raw.g, 255, 0.01);
  EXPECT_NEAR(raw.r, srgb_of_linear(0.5), 0.01);
}

TEST(Render, SignedScaleIsSharedAndIgnoresBrokenPixels) {
  StokesPlanes s = uniform(50, 50, 10, 2, 0);
  s.s2(0, 0) = -8;
  s.s1(0, 1) = std::numeric_limits<float>::infinity();
  EXPECT_DOUBLE_EQ(render_s1_s2(s, {}).scale_dn, 2);
  EXPECT_DOUBLE_EQ(render_s1_s2(uniform(5, 5, 1, 0, 0), {}).scale_dn, 0);
}

// The wheel shows every angle where the light would point, and changes nothing outside its corner.
TEST(Legend, WheelIsOrientedCounterClockwise) {
  Planes picture(3, 480, 640);
  draw_aolp_wheel(picture);
  int top = 480, bottom = 0, left = 640, right = 0;
  for (int r = 0; r < 480; ++r)
    for (int c = 0; c < 640; ++c)
      if (picture[0](r, c) > 0) {
        top = std::min(top, r), bottom = std::max(bottom, r);
        left = std::min(left, c), right = std::max(right, c);
      }
  EXPECT_GT(top, 240);
  EXPECT_GT(left, 320);
  const double centre_row = 0.5 * (top + bottom), centre_col = 0.5 * (left + right);
  const double radius = 0.2 * (bottom - top);
  for (int a : {0, 45, 90, 135, 225}) {
    const double turn = a * std::numbers::pi / 180;
    const Rgb found =
        at(picture, static_cast<int>(std::lround(centre_row - radius * std::sin(turn))),
           static_cast<int>(std::lround(centre_col + radius * std::cos(turn))));
    EXPECT_LT(distance(found, aolp_color(a)), 12) << a;
  }
}

// Truth: which segments of a seven-segment display a digit lights; 1 and 7 have other shapes here.
TEST(Legend, DigitsLightTheirSegments) {
  constexpr std::pair<int, int> kSegments[] = {{0, 1}, {1, 2}, {3, 2}, {4, 1},
                                               {3, 0}, {1, 0}, {2, 1}};  // a to g: row, column
  for (const auto& [digit, lit] : {std::pair{'0', "abcdef"},
                                   {'2', "abdeg"},
                                   {'3', "abcdg"},
                                   {'4', "bcfg"},
                                   {'5', "acdfg"},
                                   {'6', "acdefg"},
                                   {'8', "abcdefg"},
                                   {'9', "abcdfg"},
                                   {'-', "g"}}) {
    Planes picture(3, 512, 512);
    draw_bar(picture, [](double) { return Rgb{0, 0, 0}; }, {"", std::string("8") + digit, ""});
    const auto ink = [&](int r, int c) { return picture[0](r, c) > 200; };
    int top = 512, bottom = 0, left = 512;  // of the 8, which fills its field
    for (int r = 0; r < 512; ++r)
      for (int c = 0; c < 512; ++c)
        if (ink(r, c))
          top = std::min(top, r), bottom = std::max(bottom, r), left = std::min(left, c);
    const int dot = (bottom + 1 - top) / 5;
    ASSERT_GT(dot, 0);
    std::string found;
    for (int k = 0; k < 7; ++k)
      if (ink(top + kSegments[k].first * dot, left + (4 + kSegments[k].second) * dot))
        found += static_cast<char>('a' + k);
    EXPECT_EQ(found, lit) << digit;
  }
}

TEST(Legend, FitsEverySizeAndSparesTinyPictures) {
  for (const auto& [rows, cols] : {std::pair{1, 1}, {63, 500}, {64, 64}, {100, 300}, {3000, 70}}) {
    Planes picture(3, rows, cols);
    draw_aolp_wheel(picture);
    draw_bar(picture, rising_color, {"-1.23e+04", "0", "1.23e+04"});
    const auto drawn = std::count_if(picture[0].values().begin(), picture[0].values().end(),
                                     [](float v) { return v > 0; });
    EXPECT_EQ(drawn > 0, std::min(rows, cols) >= kSmallestPictureWithLegend);
    EXPECT_LT(static_cast<double>(drawn), 0.35 * rows * cols);
  }
}

}  // namespace
}  // namespace malus
