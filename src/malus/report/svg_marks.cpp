#include "malus/report/internal/colors.h"
#include "malus/report/internal/json.h"
#include "malus/report/internal/plot_area.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus::internal {
namespace {

std::string path(const std::string& steps, const std::string& color, bool dashed) {
  return fmt::format(R"(<path d="{}" fill="none" stroke="{}" stroke-width="1.4"{}/>)"
                     "\n",
                     steps, color, dashed ? R"( stroke-dasharray="6 4")" : "");
}

std::string symbol_path(Symbol symbol, double x, double y, double r) {
  switch (symbol) {
    case Symbol::kTriangle:
      return fmt::format("M{:.1f} {:.1f}l{:.1f} {:.1f}h{:.1f}z", x, y - r, r, 1.8 * r, -2 * r);
    case Symbol::kSquare:
      return fmt::format("M{:.1f} {:.1f}h{:.1f}v{:.1f}h{:.1f}z", x - r, y - r, 2 * r, 2 * r,
                         -2 * r);
    case Symbol::kDiamond:
      return fmt::format("M{:.1f} {:.1f}l{:.1f} {:.1f}l{:.1f} {:.1f}l{:.1f} {:.1f}z", x,
                         y - 1.2 * r, 1.2 * r, 1.2 * r, -1.2 * r, 1.2 * r, -1.2 * r, -1.2 * r);
    case Symbol::kCircle:
      break;
  }
  return fmt::format(
      "M{:.1f} {:.1f}a{r:.1f} {r:.1f} 0 1 0 {d:.1f} 0a{r:.1f} {r:.1f} 0 1 0 {m:.1f} 0z", x - r, y,
      fmt::arg("r", r), fmt::arg("d", 2 * r), fmt::arg("m", -2 * r));
}

// Crosses of the plot, and of its key.
std::string cross_path(double x, double y) {
  return fmt::format("M{:.1f} {:.1f}l7 7m0 -7l-7 7", x - 3.5, y - 3.5);
}

// A curve of one point, or a point between two gaps, has no line to be seen by: it gets a dot.
std::string line(const PointSeries& series, const std::string& color, const PlotArea& area) {
  std::string steps, dots;
  const auto shown = [&](std::size_t i) {
    return i < series.x.size() && area.x.shows(series.x[i]) && area.y.shows(series.y[i]);
  };
  for (std::size_t i = 0; i < series.x.size(); ++i) {
    if (!shown(i)) continue;
    const bool from_last = i > 0 && shown(i - 1);
    const double x = area.x.place(series.x[i]), y = area.y.place(series.y[i]);
    steps += fmt::format("{}{:.1f} {:.1f}", from_last ? 'L' : 'M', x, y);
    if (!from_last && !shown(i + 1)) dots += symbol_path(Symbol::kCircle, x, y, 2.2);
  }
  std::string svg = path(steps, color, series.mark == Mark::kDashed);
  if (!dots.empty()) svg += fmt::format("<path d=\"{}\" fill=\"{}\"/>\n", dots, color);
  return svg;
}

std::string points(const PointSeries& series, const Tone& tone, const PlotArea& area) {
  constexpr std::size_t kMany = 300;
  const double radius = series.x.size() > kMany ? 1.2 : 2.8;
  std::string filled, strokes;
  for (std::size_t i = 0; i < series.x.size(); ++i) {
    if (!area.x.shows(series.x[i]) || !area.y.shows(series.y[i])) continue;
    const double x = area.x.place(series.x[i]), y = area.y.place(series.y[i]);
    if (series.mark == Mark::kCrosses)
      strokes += cross_path(x, y);
    else
      filled += symbol_path(tone.symbol, x, y, radius);
    if (i < series.error.size() && std::isfinite(series.error[i]))
      // On a logarithmic axis a bar may reach down to 0 and below: it ends where the axis does.
      strokes += fmt::format("M{:.1f} {:.1f}V{:.1f}", x,
                             area.y.place_within(series.y[i] - series.error[i]),
                             area.y.place_within(series.y[i] + series.error[i]));
  }
  std::string svg;
  if (!filled.empty())
    svg += fmt::format(R"(<path d="{}" fill="{}" fill-opacity="0.8"/>)"
                       "\n",
                       filled, tone.color);
  if (!strokes.empty()) svg += path(strokes, tone.color, false);
  return svg;
}

std::string bars(const PointSeries& series, const std::string& color, const PlotArea& area) {
  double width = area.x.category_width();
  if (series.x.size() > 1) width = std::abs(area.x.to() - area.x.from());
  for (std::size_t i = 1; i < series.x.size(); ++i)
    width = std::min(width, std::abs(area.x.place(series.x[i]) - area.x.place(series.x[i - 1])));
  const double base = area.y.shows(0) ? area.y.place(0) : area.y.from();
  std::string steps;
  for (std::size_t i = 0; i < series.x.size(); ++i)
    if (area.x.shows(series.x[i]) && area.y.shows(series.y[i]))
      steps += fmt::format("M{:.1f} {:.1f}h{:.1f}V{:.1f}h{:.1f}z",
                           area.x.place(series.x[i]) - 0.45 * width, area.y.place(series.y[i]),
                           0.9 * width, base, -0.9 * width);
  return fmt::format(R"(<path d="{}" fill="{}" fill-opacity="0.55"/>)"
                     "\n",
                     steps, color);
}

std::string point_svg(const PointSeries& series, std::size_t order, const PlotArea& area) {
  const Tone tone = tone_of(series.tone, order);
  switch (series.mark) {
    case Mark::kLine:
    case Mark::kDashed:
      return line(series, tone.color, area);
    case Mark::kBars:
      return bars(series, tone.color, area);
    case Mark::kPoints:
    case Mark::kCrosses:
      break;
  }
  return points(series, tone, area);
}

std::string box_svg(const BoxSeries& series, const PlotArea& area) {
  std::string svg;
  const double half = 0.3 * area.x.category_width();
  for (std::size_t category = 0; category < series.samples.size(); ++category) {
    const Box box = box_of(series.samples[category]);
    const std::string color = tone_of(series.tones[category], 0).color;
    const double x = area.x.place(static_cast<double>(category));
    double at[5];
    for (int part = 0; part < 5; ++part) at[part] = area.y.place(box.parts[part]);
    svg += fmt::format(
        R"(<path d="M{x:.1f} {0:.1f}V{1:.1f}M{x:.1f} {3:.1f}V{4:.1f}M{left:.1f} {1:.1f}H{right:.1f}V{3:.1f}H{left:.1f}zM{left:.1f} {2:.1f}H{right:.1f}" fill="{color}" fill-opacity="0.2" stroke="{color}" stroke-width="1.3"/>)"
        "\n",
        at[0], at[1], at[2], at[3], at[4], fmt::arg("x", x), fmt::arg("left", x - half),
        fmt::arg("right", x + half), fmt::arg("color", color));
    for (const double value : box.outliers)
      svg += fmt::format(R"(<circle cx="{:.1f}" cy="{:.1f}" r="1.6" fill="{}"/>)"
                         "\n",
                         x, area.y.place(value), color);
  }
  return svg;
}

std::string heat_svg(const HeatSeries& series, const PlotArea& area) {
  std::string svg;
  const double width = area.x.category_width(), height = area.y.category_width();
  const double span = series.high > series.low ? series.high - series.low : 1;
  for (std::size_t r = 0; r < series.cells.size(); ++r)
    for (std::size_t c = 0; c < series.cells[r].size(); ++c) {
      const double value = series.cells[r][c];
      if (!std::isfinite(value)) continue;
      const double t = std::clamp((value - series.low) / span, 0.0, 1.0);
      svg += fmt::format(
          R"(<rect x="{:.2f}" y="{:.2f}" width="{:.2f}" height="{:.2f}" fill="{}"><title>{:.4g}</title></rect>)"
          "\n",
          area.x.place(static_cast<double>(c)) - width / 2,
          area.y.place(static_cast<double>(r)) - height / 2, width + 0.05, height + 0.05,
          css_color(palette_color(series.palette, t)), value);
    }
  return svg;
}

}  // namespace

std::string key_mark_svg(Mark mark, const Tone& tone, double x, double y) {
  switch (mark) {
    case Mark::kLine:
    case Mark::kDashed:
      return path(fmt::format("M{:.1f} {:.1f}h16", x - 8, y), tone.color, mark == Mark::kDashed);
    case Mark::kCrosses:
      return path(cross_path(x, y), tone.color, false);
    case Mark::kBars:
      return fmt::format(
          R"(<rect x="{:.1f}" y="{:.1f}" width="10" height="10" fill="{}" fill-opacity="0.55"/>)"
          "\n",
          x - 5, y - 5, tone.color);
    case Mark::kPoints:
      break;
  }
  return fmt::format("<path d=\"{}\" fill=\"{}\"/>\n", symbol_path(tone.symbol, x, y, 3.4),
                     tone.color);
}

std::string series_svg(const Series& series, std::size_t order, const PlotArea& area) {
  if (const auto* points = std::get_if<PointSeries>(&series))
    return point_svg(*points, order, area);
  if (const auto* boxes = std::get_if<BoxSeries>(&series)) return box_svg(*boxes, area);
  return heat_svg(std::get<HeatSeries>(series), area);
}

}  // namespace malus::internal
