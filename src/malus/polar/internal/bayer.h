// Red, green and blue at every pixel of a Bayer picture: what demosaicking with and without
// polarizers shares.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"

#include <functional>
#include <map>

namespace malus::internal {

// Settings relative to the mosaic's mean square, chosen on polar-scenes (docs/polarization.md).
inline constexpr double kGuideEpsilon = 1.2e-3;  // variance below which a guide is not trusted
inline constexpr double kGradientFloor =
    0.01;                                // gradients below it, relative to the rms, are noise
inline constexpr double kTinyDn = 1e-6;  // keeps weights of dark frames finite in float

/// Both greens are one colour of a picture.
inline Color display_color(Color color) { return color == Color::kGreen2 ? Color::kGreen1 : color; }

double mean_square(const Image& image);

/// Whether arithmetic in float can be done with a pixel: finite, and its square far from the end.
bool is_usable(float dn);

/// Pixels that are not usable get the mean of the usable samples of their channel one cell away,
/// from the rim of a hole inwards. 0 in channels that have none.
Image filled(View<const float> mosaic, const SensorLayout& layout);

/// bayer: finite, at least 4 x 4. color_at: kGreen1 on one diagonal, two other colours on the
/// other. Green by Hamilton and Adams, the others by residual interpolation along it (lattice.h).
std::map<Color, Image> bayer_colors(const Image& bayer,
                                    const std::function<Color(int, int)>& color_at, double epsilon);

}  // namespace malus::internal
