#include "malus/polar/color_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace malus {
namespace {

struct OkLab {
  double lightness, a, b;
};

// Piecewise linear through equally spaced anchors.
template <std::size_t N>
Rgb interpolated(const std::array<OkLab, N>& anchors, double fraction) {
  const double position = std::clamp(fraction, 0.0, 1.0) * (N - 1);
  const std::size_t i = std::min<std::size_t>(static_cast<std::size_t>(position), N - 2);
  const double t = position - static_cast<double>(i);
  const OkLab &from = anchors[i], &to = anchors[i + 1];
  return rgb_of_oklab(std::lerp(from.lightness, to.lightness, t), std::lerp(from.a, to.a, t),
                      std::lerp(from.b, to.b, t));
}

// Lightness rises by equal steps; hue turns from violet to yellow.
constexpr std::array<OkLab, 6> kRising = {{{0.00, 0.00, 0.00},
                                           {0.20, 0.05, -0.10},
                                           {0.40, 0.14, -0.07},
                                           {0.60, 0.17, 0.07},
                                           {0.80, 0.05, 0.15},
                                           {0.98, -0.02, 0.08}}};

constexpr std::array<OkLab, 5> kTwoSided = {{{0.30, -0.02, -0.13},
                                             {0.63, -0.05, -0.11},
                                             {0.96, 0.00, 0.00},
                                             {0.63, 0.14, 0.08},
                                             {0.30, 0.12, 0.05}}};

}  // namespace

float srgb_of_linear(double linear) {
  const double x = std::clamp(linear, 0.0, 1.0);
  const double coded = x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
  return static_cast<float>(255 * coded);
}

double srgb_to_linear(double value) {
  return value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
}

Rgb rgb_of_oklab(double lightness, double a, double b) {
  const auto cube = [](double x) { return x * x * x; };
  const double l = cube(lightness + 0.3963377774 * a + 0.2158037573 * b);
  const double m = cube(lightness - 0.1055613458 * a - 0.0638541728 * b);
  const double s = cube(lightness - 0.0894841775 * a - 1.2914855480 * b);
  return {srgb_of_linear(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
          srgb_of_linear(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
          srgb_of_linear(-0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s)};
}

Rgb aolp_color(double aolp_deg, double strength) {
  // The lightness at which the largest chroma fits into sRGB for every hue, just inside it.
  constexpr double kLightness = 0.74, kChroma = 0.124, kHueOfZeroDeg = 20;
  const double hue = (2 * aolp_deg + kHueOfZeroDeg) * std::numbers::pi / 180;
  const double held = std::clamp(strength, 0.0, 1.0);
  return rgb_of_oklab(held * kLightness, held * kChroma * std::cos(hue),
                      held * kChroma * std::sin(hue));
}

Rgb rising_color(double fraction) { return interpolated(kRising, fraction); }

Rgb two_sided_color(double value) { return interpolated(kTwoSided, 0.5 * (value + 1)); }

Rgb undefined_color(int row, int col) {
  constexpr int kCheck = 8;
  const float grey = (row / kCheck + col / kCheck) % 2 == 0 ? 96.0f : 128.0f;
  return {grey, grey, grey};
}

}  // namespace malus
