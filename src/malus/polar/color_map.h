// Colours for polarization pictures: a cyclic wheel for angles, a rising map for DoLP, a two-sided
// one for S1 and S2. All are laid out in OKLab, where equal steps look equal (B. Ottosson, "A
// perceptual color space for image processing", 2020).
#pragma once

namespace malus {

/// As displayed: sRGB-coded, 0..255.
struct Rgb {
  float r = 0, g = 0, b = 0;
};

/// OKLab (L 0..1, a, b) to sRGB; colours outside the gamut are clipped per channel.
Rgb rgb_of_oklab(double lightness, double a, double b);

/// sRGB's transfer curve (IEC 61966-2-1): linear light 0..1, clipped, to 0..255.
float srgb_of_linear(double linear);
/// The curve undone; value and result in [0, 1].
double srgb_to_linear(double value);

/// Angle wheel with a period of 180 degrees and one lightness all around, so that no angle looks
/// stronger than another: red 0, green about 60, blue about 120. strength 0..1 fades to black.
Rgb aolp_color(double aolp_deg, double strength = 1);

/// Rising in lightness from black over violet and orange to pale yellow; fraction is held to 0..1.
Rgb rising_color(double fraction);

/// Blue (-1) over light grey (0) to red (+1); equal lightness at equal distance from 0.
Rgb two_sided_color(double value);

/// A grey check pattern that no map contains: the pixel has no defined value.
Rgb undefined_color(int row, int col);

}  // namespace malus
