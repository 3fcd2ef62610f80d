#include "malus/report/internal/svg.h"

#include "malus/report/internal/colors.h"
#include "malus/report/internal/plot_area.h"

#include <algorithm>
#include <set>

#include <fmt/format.h>

namespace malus {
namespace {

using internal::PlotArea;
using internal::PlotAxis;
using internal::xml_safe;

constexpr double kWidth = 720, kHeight = 460, kLeft = 78, kTop = 34, kBottom = 62;
constexpr double kRightPlain = 20, kRightLegend = 130;
constexpr const char* kInk = "#1c2430";

std::string axis_title(const Axis& axis) {
  if (axis.unit == "1" || axis.unit.empty()) return xml_safe(axis.name);
  std::string unit = axis.unit;
  if (const std::size_t at = unit.find("^2"); at != std::string::npos) unit.replace(at, 2, "²");
  return xml_safe(axis.name + " [" + unit + "]");
}

std::string text(double x, double y, std::string_view anchor, std::string_view content,
                 std::string_view more = {}) {
  return fmt::format(R"(<text x="{:.1f}" y="{:.1f}" text-anchor="{}"{}>{}</text>)"
                     "\n",
                     x, y, anchor, more, content);
}

std::string frame(const Chart& chart, const PlotArea& area) {
  const double left = area.x.from(), right = area.x.to();
  const double bottom = std::max(area.y.from(), area.y.to()), top = kTop;
  std::string svg;
  const bool slanted = chart.x.categories.size() > 8;
  for (const auto& [at, label] : area.x.ticks()) {
    if (chart.x.scale != AxisScale::kCategory)
      svg += fmt::format(R"(<path d="M{:.1f} {:.1f}V{:.1f}" stroke="#e3e7ec"/>)"
                         "\n",
                         at, bottom, top);
    svg += slanted
               ? text(at, bottom + 12, "end", xml_safe(label),
                      fmt::format(R"x( transform="rotate(-50 {:.1f} {:.1f})")x", at, bottom + 12))
               : text(at, bottom + 18, "middle", xml_safe(label));
  }
  for (const auto& [at, label] : area.y.ticks()) {
    if (chart.y.scale != AxisScale::kCategory)
      svg += fmt::format(R"(<path d="M{:.1f} {:.1f}H{:.1f}" stroke="#e3e7ec"/>)"
                         "\n",
                         left, at, right);
    svg += text(left - 7, at + 4, "end", xml_safe(label));
  }
  svg += fmt::format(R"(<path d="M{:.1f} {:.1f}V{:.1f}H{:.1f}" fill="none" stroke="#1c2430"/>)"
                     "\n",
                     left, top, bottom, right);
  svg += text((left + right) / 2, kHeight - 10, "middle", axis_title(chart.x));
  const double middle = (top + bottom) / 2;
  svg += text(18, middle, "middle", axis_title(chart.y),
              fmt::format(R"x( transform="rotate(-90 18 {:.1f})")x", middle));
  return svg;
}

// What the key explains: channels by their colour and symbol, and once what their lines and crosses
// are ("R, fit" beside "R").
struct KeyEntry {
  std::string name;
  Mark mark = Mark::kPoints;
  Tone tone;
};

std::vector<KeyEntry> key_entries(const Chart& chart) {
  std::set<std::string> names, listed;
  for (const Series& series : chart.series)
    if (const auto* points = std::get_if<PointSeries>(&series)) names.insert(points->name);
  std::vector<KeyEntry> own, common;
  for (std::size_t i = 0; i < chart.series.size(); ++i) {
    const auto* series = std::get_if<PointSeries>(&chart.series[i]);
    if (series == nullptr) continue;
    const std::size_t comma = series->name.rfind(", ");
    const bool of_another =
        comma != std::string::npos && names.contains(series->name.substr(0, comma));
    const std::string name = of_another ? series->name.substr(comma + 2) : series->name;
    if (!listed.insert(name).second) continue;
    (of_another ? common : own)
        .push_back({name, series->mark, of_another ? Tone{kInk} : tone_of(series->tone, i)});
  }
  own.insert(own.end(), common.begin(), common.end());
  return own;
}

std::string legend(const Chart& chart) {
  constexpr double kRow = 18, kNarrowestRow = 10.5, kBelow = 12;
  const std::vector<KeyEntry> entries = key_entries(chart);
  const double x = kWidth - kRightLegend + 18, height = kHeight - kTop - kBelow;
  const double row = std::clamp(height / static_cast<double>(entries.size()), kNarrowestRow, kRow);
  const auto fit = static_cast<std::size_t>(height / row + 1e-9);
  const std::string size = row < 13 ? fmt::format(R"( font-size="{:.1f}")", row - 0.5) : "";
  std::string svg;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const double y = kTop + 10 + row * static_cast<double>(i);
    if (i + 1 == fit && entries.size() > fit)
      return svg + text(x + 12, y, "start", fmt::format("and {} more", entries.size() - i), size);
    svg += internal::key_mark_svg(entries[i].mark, entries[i].tone, x, y - 4);
    svg += text(x + 12, y, "start", xml_safe(entries[i].name), size);
  }
  return svg;
}

std::string heat_key(const HeatSeries& series) {
  std::string svg;
  const double x = kWidth - kRightLegend + 24, height = 160, top = kTop + 30;
  constexpr int kSteps = 40;
  for (int i = 0; i < kSteps; ++i)
    svg += fmt::format(R"(<rect x="{:.1f}" y="{:.1f}" width="16" height="{:.1f}" fill="{}"/>)"
                       "\n",
                       x, top + height * (kSteps - 1 - i) / kSteps, height / kSteps + 0.3,
                       css_color(palette_color(series.palette, (i + 0.5) / kSteps)));
  svg += text(x + 22, top + 8, "start", fmt::format("{:.3g}", series.high));
  svg += text(x + 22, top + height, "start", fmt::format("{:.3g}", series.low));
  if (series.unit != "1") svg += text(x, top - 10, "start", xml_safe(series.unit));
  return svg;
}

}  // namespace

std::string chart_svg(const Chart& chart) {
  const HeatSeries* heat =
      chart.series.empty() ? nullptr : std::get_if<HeatSeries>(&chart.series.front());
  const bool keyed = heat != nullptr || chart.series.size() > 1;
  const double right = kWidth - (keyed ? kRightLegend : kRightPlain);
  const internal::Range across = internal::range_of(chart, true);
  const internal::Range up = internal::range_of(chart, false);
  // Rows of a heat map go down from the top.
  const bool down = chart.y.scale == AxisScale::kCategory;
  const double bottom = kHeight - kBottom;
  const PlotArea area{
      PlotAxis(chart.x, across.low, across.high, kLeft, right),
      PlotAxis(chart.y, up.low, up.high, down ? kTop : bottom, down ? bottom : kTop)};
  std::string svg = fmt::format(
      R"(<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {0} {1}" width="{0}" height="{1}" role="img" font-family="Helvetica, Arial, sans-serif" font-size="12" fill="#1c2430">)"
      "\n<title>{2}</title>\n<desc>{3}</desc>\n<rect width=\"{0}\" height=\"{1}\" "
      "fill=\"#ffffff\"/>\n",
      kWidth, kHeight, xml_safe(chart.title), xml_safe(chart.text));
  svg += text(kLeft, 20, "start", xml_safe(chart.title), R"( font-size="14" font-weight="bold")");
  svg += frame(chart, area);
  for (std::size_t i = 0; i < chart.series.size(); ++i)
    svg += internal::series_svg(chart.series[i], i, area);
  if (heat != nullptr)
    svg += heat_key(*heat);
  else if (keyed)
    svg += legend(chart);
  return svg + "</svg>\n";
}

}  // namespace malus
