#include "malus/image/layout.h"

#include "malus/base/error.h"
#include "malus/base/text.h"

#include <algorithm>
#include <array>
#include <charconv>

#include <fmt/format.h>

namespace malus {
namespace {

using SiteNames = std::vector<std::vector<std::string>>;

struct NamedLayout {
  const char* name;
  SiteNames cell;
};

// Sony's block of four polarizers, IMX250MZR/MYR data sheets: [90 45; 135 0].
constexpr std::array<std::array<int, 2>, 2> kSonyBlock = {{{90, 45}, {135, 0}}};

SiteNames polar_bayer(const SiteNames& bayer) {
  SiteNames cell(4, std::vector<std::string>(4));
  for (std::size_t r = 0; r < 4; ++r)
    for (std::size_t c = 0; c < 4; ++c) {
      const std::string& color = bayer[r / 2][c / 2];
      cell[r][c] =
          fmt::format("{}{}{}", color, color.size() > 1 ? "_" : "", kSonyBlock[r % 2][c % 2]);
    }
  return cell;
}

const std::vector<NamedLayout>& registry() {
  static const std::vector<NamedLayout> layouts = [] {
    const std::vector<std::pair<std::string, SiteNames>> bayer = {
        {"rggb", {{"R", "G1"}, {"G2", "B"}}},
        {"bggr", {{"B", "G1"}, {"G2", "R"}}},
        {"grbg", {{"G1", "R"}, {"B", "G2"}}},
        {"gbrg", {{"G1", "B"}, {"R", "G2"}}}};
    std::vector<NamedLayout> all = {{"mono", {{"mono"}}},
                                    {"bayer-rggb", bayer[0].second},
                                    {"bayer-bggr", bayer[1].second},
                                    {"bayer-grbg", bayer[2].second},
                                    {"bayer-gbrg", bayer[3].second},
                                    {"polar-mono", {{"90", "45"}, {"135", "0"}}},
                                    {"polar-bayer-rggb", polar_bayer(bayer[0].second)},
                                    {"polar-bayer-bggr", polar_bayer(bayer[1].second)},
                                    {"polar-bayer-grbg", polar_bayer(bayer[2].second)},
                                    {"polar-bayer-gbrg", polar_bayer(bayer[3].second)}};
    return all;
  }();
  return layouts;
}

// "R90", "G1_45", "G145" is refused as ambiguous: greens need the underscore; "90"; "R"; "mono".
std::optional<Site> parse_site(std::string_view text) {
  Site site;
  if (text == "mono") return site;
  for (const auto& [name, color] : {std::pair<std::string_view, Color>{"G1", Color::kGreen1},
                                    {"G2", Color::kGreen2},
                                    {"R", Color::kRed},
                                    {"B", Color::kBlue}}) {
    if (!text.starts_with(name)) continue;
    site.color = color;
    text.remove_prefix(name.size());
    if (text.empty()) return site;
    if (text.front() == '_')
      text.remove_prefix(1);
    else if (name.size() > 1)
      return std::nullopt;
    break;
  }
  int angle = -1;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), angle);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  if (angle != 0 && angle != 45 && angle != 90 && angle != 135) return std::nullopt;
  site.angle_deg = angle;
  return site;
}

}  // namespace

std::string_view color_name(Color color) {
  switch (color) {
    case Color::kMono:
      return "mono";
    case Color::kRed:
      return "R";
    case Color::kGreen1:
      return "G1";
    case Color::kGreen2:
      return "G2";
    case Color::kBlue:
      return "B";
  }
  return "";
}

SensorLayout::SensorLayout() : sites_(1), name_("mono") {}

std::vector<std::string> SensorLayout::known_names() {
  std::vector<std::string> names;
  for (const auto& layout : registry()) names.emplace_back(layout.name);
  return names;
}

SensorLayout SensorLayout::named(std::string_view name) {
  for (const auto& layout : registry())
    if (name == layout.name) return from_sites(layout.cell);
  const auto names = known_names();
  throw InputError(fmt::format("layout \"{}\"", name), "is no known sensor layout",
                   did_you_mean(name, names) + "known: " + joined(names));
}

SensorLayout SensorLayout::from_sites(const SiteNames& rows) {
  const std::string remedy =
      fmt::format("give 1 to {} rows of equal length with sites such as R90, G1_45, B, 135 or mono",
                  kLargestCell);
  if (rows.empty() || rows[0].empty() || std::ssize(rows) > kLargestCell ||
      std::ssize(rows[0]) > kLargestCell)
    throw InputError(
        "sensor cell",
        fmt::format("has {} rows and {} columns", rows.size(), rows.empty() ? 0 : rows[0].size()),
        remedy);
  SensorLayout layout;
  layout.rows_ = static_cast<int>(rows.size());
  layout.cols_ = static_cast<int>(rows[0].size());
  layout.sites_.clear();
  for (const auto& row : rows) {
    if (row.size() != rows[0].size())
      throw InputError("sensor cell",
                       fmt::format("has rows of {} and {} sites", rows[0].size(), row.size()),
                       remedy);
    for (const auto& text : row) {
      const auto site = parse_site(text);
      if (!site)
        throw InputError("sensor cell", fmt::format("has an unknown site \"{}\"", text), remedy);
      layout.sites_.push_back(*site);
    }
  }
  layout.name_ = "custom";
  for (const auto& known : registry())
    if (known.cell.size() == rows.size() && known.cell[0].size() == rows[0].size()) {
      bool same = true;
      for (int i = 0; i < layout.channels() && same; ++i)
        same = parse_site(known.cell[static_cast<std::size_t>(i / layout.cols_)]
                                    [static_cast<std::size_t>(i % layout.cols_)]) == layout.site(i);
      if (same) layout.name_ = known.name;
    }
  return layout;
}

std::string SensorLayout::channel_name(int channel) const {
  const Site& s = site(channel);
  if (!s.angle_deg) return std::string(color_name(s.color));
  if (s.color == Color::kMono) return fmt::format("{}", *s.angle_deg);
  const auto color = color_name(s.color);
  return fmt::format("{}{}{}", color, color.size() > 1 ? "_" : "", *s.angle_deg);
}

std::vector<std::string> SensorLayout::channel_names() const {
  std::vector<std::string> names;
  for (int i = 0; i < channels(); ++i) names.push_back(channel_name(i));
  return names;
}

std::vector<Color> SensorLayout::colors() const {
  std::vector<Color> present;
  for (Color color : {Color::kRed, Color::kGreen1, Color::kGreen2, Color::kBlue, Color::kMono})
    if (std::any_of(sites_.begin(), sites_.end(), [&](const Site& s) { return s.color == color; }))
      present.push_back(color);
  return present;
}

bool SensorLayout::colored() const { return colors().size() > 1; }

bool SensorLayout::polarized() const {
  for (Color color : colors())
    for (int angle : {0, 45, 90, 135})
      if (find(color, angle) < 0) return false;
  return true;
}

int SensorLayout::find(Color color, std::optional<int> angle_deg) const {
  for (int i = 0; i < channels(); ++i)
    if (site(i).color == color && site(i).angle_deg == angle_deg) return i;
  return -1;
}

std::optional<CellPhase> SensorLayout::phase_in(const SensorLayout& other) const {
  if (other.rows_ % rows_ != 0 || other.cols_ % cols_ != 0) return std::nullopt;
  const bool grey = colors() == std::vector<Color>{Color::kMono};
  const auto alike = [&](const Site& a, const Site& b) {
    const auto hue = [](Color color) { return color == Color::kGreen2 ? Color::kGreen1 : color; };
    return (grey || hue(a.color) == hue(b.color)) && a.angle_deg == b.angle_deg;
  };
  for (int row = 0; row < other.rows_; ++row)
    for (int col = 0; col < other.cols_; ++col) {
      bool same = true;
      for (int r = 0; r < other.rows_ && same; ++r)
        for (int c = 0; c < other.cols_ && same; ++c)
          same = alike(site(channel_at(r, c)), other.site(other.channel_at(r + row, c + col)));
      if (same) return CellPhase{row, col};
    }
  return std::nullopt;
}

}  // namespace malus
