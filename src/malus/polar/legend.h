// Legends drawn into the lower right corner of a picture: the angle wheel and labelled bars.
#pragma once

#include "malus/image/view.h"
#include "malus/polar/color_map.h"

#include <array>
#include <functional>
#include <string>
#include <string_view>

namespace malus {

/// Pictures below this many rows or columns stay without a legend: it would hide too much. Below
/// four times 64 the legend has no labels.
inline constexpr int kSmallestPictureWithLegend = 64;

/// picture: 3 planes, 0..255. Every angle appears twice around the circle; 0, 45, 90 and 135 are
/// labelled, counter-clockwise from the right.
void draw_aolp_wheel(Planes& picture);

/// A vertical bar from bottom (fraction 0) to top (1) with labels at the bottom, middle and top.
/// Labels hold digits, '.', '-', '+' and 'e'; other letters leave a gap.
void draw_bar(Planes& picture, const std::function<Rgb(double)>& color_of_fraction,
              const std::array<std::string, 3>& labels);

}  // namespace malus
