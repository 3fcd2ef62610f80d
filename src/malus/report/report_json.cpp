#include "malus/base/error.h"
#include "malus/report/internal/colors.h"
#include "malus/report/internal/json.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace malus::internal {
namespace {

template <class... Cases>
struct Overloaded : Cases... {
  using Cases::operator()...;
};
template <class... Cases>
Overloaded(Cases...) -> Overloaded<Cases...>;  // clang before 17 asks for it

Json numbers(const std::vector<double>& values) {
  Json list = Json::array();
  for (const double value : values) list.push_back(json_number(value));
  return list;
}

Json measured(const Measured& measured) {
  return {{"value", json_number(measured.value)}, {"error", json_number(measured.standard_error)}};
}

// Words where a number has no digits: no metric of two pictures that are equal has any.
Json table_cell(const TableBlock::Cell& cell) {
  if (const auto* text = std::get_if<std::string>(&cell)) return *text;
  const auto& value = std::get<Measured>(cell);
  return value.value == std::numeric_limits<double>::infinity() ? Json("infinite")
                                                                : measured(value);
}

Json optional_number(const std::optional<double>& value) { return value ? Json(*value) : Json(); }

Json axis(const Axis& axis) {
  static constexpr const char* kScales[] = {"linear", "log", "category"};
  return {{"name", axis.name},
          {"unit", axis.unit},
          {"scale", kScales[static_cast<int>(axis.scale)]},
          {"categories", axis.categories},
          {"low", optional_number(axis.low)},
          {"high", optional_number(axis.high)}};
}

Json point_series(const PointSeries& series, std::size_t order) {
  MALUS_REQUIRE(series.x.size() == series.y.size());
  MALUS_REQUIRE(series.error.empty() || series.error.size() == series.x.size());
  static constexpr const char* kMarks[] = {"line", "dashed", "points", "crosses", "bars"};
  static constexpr const char* kSymbols[] = {"circle", "triangle", "square", "diamond"};
  const Tone tone = tone_of(series.tone, order);
  return {{"name", series.name},
          {"mark", kMarks[static_cast<int>(series.mark)]},
          {"color", tone.color},
          {"symbol", kSymbols[static_cast<int>(tone.symbol)]},
          {"x", numbers(series.x)},
          {"y", numbers(series.y)},
          {"error", numbers(series.error)},
          {"notes", series.notes}};
}

Json box_series(const BoxSeries& series) {
  MALUS_REQUIRE(series.tones.size() == series.samples.size());
  Json boxes = Json::array(), outliers = Json::array(), colors = Json::array();
  for (std::size_t category = 0; category < series.samples.size(); ++category) {
    const Box box = box_of(series.samples[category]);
    colors.push_back(tone_of(series.tones[category], 0).color);
    boxes.push_back(
        numbers({box.parts[0], box.parts[1], box.parts[2], box.parts[3], box.parts[4]}));
    for (const double value : box.outliers)
      outliers.push_back({{"category", category}, {"value", value}});
  }
  return {{"name", series.name},
          {"mark", "boxes"},
          {"colors", colors},
          {"boxes", boxes},
          {"outliers", outliers}};
}

Json heat_series(const HeatSeries& series) {
  Json cells = Json::array();
  for (const auto& row : series.cells) cells.push_back(numbers(row));
  return {{"name", series.name}, {"mark", "heat"},      {"cells", cells},
          {"low", series.low},   {"high", series.high}, {"palette", palette_name(series.palette)},
          {"unit", series.unit}};
}

Json chart_json(const Chart& chart) {
  Json list = Json::array();
  for (const Series& series : chart.series)
    list.push_back(
        std::visit(Overloaded{[&](const PointSeries& s) { return point_series(s, list.size()); },
                              [](const BoxSeries& s) { return box_series(s); },
                              [](const HeatSeries& s) { return heat_series(s); }},
                   series));
  return {{"title", chart.title},
          {"text", chart.text},
          {"x", axis(chart.x)},
          {"y", axis(chart.y)},
          {"series", list}};
}

Json notices(const NoticesBlock& block) {
  static constexpr const char* kLevels[] = {"good", "note", "warning"};
  Json items = Json::array();
  for (const auto& [level, text] : block.items)
    items.push_back({{"level", kLevels[static_cast<int>(level)]}, {"text", text}});
  return {{"kind", "notices"}, {"items", items}};
}

Json figures(const FiguresBlock& block) {
  Json items = Json::array();
  for (const auto& item : block.items) {
    Json made = {
        {"name", item.name}, {"symbol", item.symbol}, {"unit", item.unit}, {"note", item.note}};
    made.update(measured(item.value));
    items.push_back(made);
  }
  return {{"kind", "figures"}, {"items", items}};
}

Json table(const TableBlock& block) {
  Json columns = Json::array(), rows = Json::array();
  for (const auto& [name, unit] : block.columns)
    columns.push_back({{"name", name}, {"unit", unit}});
  for (const auto& row : block.rows) {
    MALUS_REQUIRE(row.cells.size() == block.columns.size());
    Json cells = Json::array();
    for (const auto& cell : row.cells) cells.push_back(table_cell(cell));
    rows.push_back({{"name", row.name}, {"cells", cells}});
  }
  return {{"kind", "table"},    {"title", block.title}, {"note", block.note},
          {"head", block.head}, {"columns", columns},   {"rows", rows}};
}

Json charts(const ChartsBlock& block) {
  MALUS_REQUIRE(!block.charts.empty());
  Json list = Json::array();
  for (const auto& [name, chart] : block.charts)
    list.push_back({{"name", name}, {"chart", chart_json(chart)}});
  return {{"kind", "charts"}, {"choice", block.choice}, {"wide", block.wide}, {"charts", list}};
}

Json palettes() {
  Json all;
  constexpr int kColors = 65;
  for (const Palette palette :
       {Palette::kGrey, Palette::kSequential, Palette::kDiverging, Palette::kCyclic}) {
    Json& list = all[palette_name(palette)] = Json::array();
    for (int i = 0; i < kColors; ++i)
      list.push_back(css_color(palette_color(palette, static_cast<double>(i) / (kColors - 1))));
  }
  return all;
}

// What a viewer has to hold: its pixels, all pictures and maps together.
double pixels_of(const PicturesBlock& block) {
  double pixels =
      static_cast<double>(block.rows) * block.cols * static_cast<double>(block.pictures.size());
  for (const Layer& layer : block.layers)
    for (const Image& map : layer.maps) pixels += static_cast<double>(map.size());
  return pixels;
}

double all_pixels(const Report& report) {
  double pixels = 0;
  for (const Section& section : report.sections)
    for (const Block& block : section.blocks)
      if (const auto* pictures = std::get_if<PicturesBlock>(&block)) pixels += pixels_of(*pictures);
  return pixels;
}

// A list: pictures may need a second block for a crop.
Json block_json(const Block& block, double bytes_per_pixel, std::vector<Blob>& blobs) {
  const auto one = [](Json made) { return Json::array({std::move(made)}); };
  return std::visit(Overloaded{
                        [&](const TextBlock& b) {
                          return one({{"kind", "text"}, {"paragraphs", b.paragraphs}});
                        },
                        [&](const NoticesBlock& b) { return one(notices(b)); },
                        [&](const FiguresBlock& b) { return one(figures(b)); },
                        [&](const TableBlock& b) { return one(table(b)); },
                        [&](const ChartsBlock& b) { return one(charts(b)); },
                        [&](const PicturesBlock& b) {
                          return pictures_json(b, bytes_per_pixel * pixels_of(b), blobs);
                        },
                    },
                    block);
}

}  // namespace

Json json_number(double value) { return std::isfinite(value) ? Json(value) : Json(); }

const char* palette_name(Palette palette) {
  static constexpr const char* kNames[] = {"grey", "sequential", "diverging", "cyclic"};
  return kNames[static_cast<int>(palette)];
}

Json report_json(const Report& report, const ReportSettings& settings, std::vector<Blob>& blobs) {
  constexpr double kBytesPerMib = 1 << 20;
  const double bytes_per_pixel =
      settings.picture_budget_mib * kBytesPerMib / std::max(1.0, all_pixels(report));
  Json sections = Json::array();
  for (const Section& section : report.sections) {
    Json blocks = Json::array();
    for (const Block& block : section.blocks)
      for (Json& made : block_json(block, bytes_per_pixel, blobs))
        blocks.push_back(std::move(made));
    sections.push_back(
        {{"id", section.id}, {"title", section.title}, {"lead", section.lead}, {"blocks", blocks}});
  }
  constexpr int kFormat = 1;  // web/src/contract.ts
  return {{"format", kFormat},         {"title", report.title},  {"subtitle", report.subtitle},
          {"program", report.program}, {"palettes", palettes()}, {"sections", sections}};
}

}  // namespace malus::internal
