#include "malus/report/internal/colors.h"

#include "malus/polar/color_map.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

PaletteColor oklab(double lightness, double a, double b) {
  const Rgb color = rgb_of_oklab(lightness, a, b);
  const auto byte = [](float value) { return static_cast<std::uint8_t>(std::lround(value)); };
  return {byte(color.r), byte(color.g), byte(color.b)};
}

}  // namespace

PaletteColor palette_color(Palette palette, double t) {
  switch (palette) {
    case Palette::kGrey:
      break;
    case Palette::kSequential:
      return oklab(0.2 + 0.74 * t, 0.02 - 0.04 * t, -0.11 + 0.27 * t);
    case Palette::kDiverging: {
      const double side = 2 * t - 1;
      return oklab(0.97 - 0.42 * std::abs(side), 0.055 * std::max(side, 0.0), 0.14 * side);
    }
    case Palette::kCyclic: {
      const double angle = 2 * std::numbers::pi * t;
      return oklab(0.6 + 0.33 * std::cos(angle), 0.05 * std::sin(angle), 0.13 * std::sin(angle));
    }
  }
  return oklab(t, 0, 0);
}

std::string css_color(const PaletteColor& color) {
  return fmt::format("#{:02x}{:02x}{:02x}", color[0], color[1], color[2]);
}

const std::vector<std::string>& series_colors() {
  static const std::vector<std::string> kColors = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                                   "#6072fc", "#3a9bd1", "#666c6c"};
  return kColors;
}

Tone tone_of(std::string_view channel, std::size_t order) {
  static constexpr std::array<std::pair<std::string_view, std::string_view>, 5> kFilters = {
      {{"G1", "#009e73"},
       {"G2", "#247872"},
       {"R", "#d55e00"},
       {"B", "#0072b2"},
       {"mono", "#7f7f7f"}}};
  static constexpr std::array<std::string_view, 4> kAngles = {"0", "45", "90", "135"};
  Tone tone{series_colors()[order % series_colors().size()], Symbol::kCircle};
  std::string_view angle = channel;
  for (const auto& [filter, color] : kFilters)
    if (channel.starts_with(filter)) {
      tone.color = color;
      angle.remove_prefix(filter.size());
      break;
    }
  if (angle.starts_with('_')) angle.remove_prefix(1);
  const auto found = std::find(kAngles.begin(), kAngles.end(), angle);
  if (found != kAngles.end()) {
    tone.symbol = static_cast<Symbol>(found - kAngles.begin());
    // Without filters the angle gives the colour too.
    if (channel == angle)
      tone.color = series_colors()[static_cast<std::size_t>(found - kAngles.begin())];
  }
  return tone;
}

}  // namespace malus
