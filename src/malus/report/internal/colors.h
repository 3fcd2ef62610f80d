// The colours of plots and maps, readable with red-green colour blindness. The page gets them from
// here with every report.
#pragma once

#include "malus/report/report.h"

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace malus {

using PaletteColor = std::array<std::uint8_t, 3>;

/// The colour of t in [0, 1]; the cyclic palette has the same one at both ends. All palettes lie in
/// the lightness and blue-yellow plane of OKLab (polar/color_map.h), which protan and deutan vision
/// keeps.
PaletteColor palette_color(Palette palette, double t);

/// "#rrggbb"
std::string css_color(const PaletteColor& color);

/// Colours of series without a tone, in order: after Okabe and Ito, "Color universal design", 2008.
/// Any two are at least 0.06 apart in OKLab with normal, protan and deutan vision (Machado et al.,
/// IEEE TVCG 15, 2009, severity 1; about 0.02 is just seen), and so are a mosaic's filters.
const std::vector<std::string>& series_colors();

enum class Symbol { kCircle, kTriangle, kSquare, kDiamond };
struct Tone {
  std::string color;
  Symbol symbol = Symbol::kCircle;
};
/// Channels are told by colour (their filter) and symbol (their angle): "G1_45", "R0", "B", "135".
/// Anything else has the colour of its place in the order.
Tone tone_of(std::string_view channel, std::size_t order);

}  // namespace malus
