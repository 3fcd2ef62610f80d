#include "malus/base/error.h"
#include "malus/io/frame_file.h"
#include "malus/report/write_report.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <string_view>

#include "program.h"
#include "report_pages.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;

double number_of(const Json& json) {
  return json.is_number() ? json.get<double>() : Measured::kNone;
}

std::string text_at(const Json& json, const char* key) {
  return json.contains(key) && json.at(key).is_string() ? json.at(key).get<std::string>() : "";
}

TableBlock::Cell cell_of(const Json& json) {
  if (json.is_string()) return json.get<std::string>();
  if (json.is_object())
    return Measured{number_of(json.value("value", Json())),
                    number_of(json.value("stderr", Json()))};
  return Measured{number_of(json), Measured::kNone};
}

TableBlock table_block(const Json& json) {
  TableBlock table{.title = text_at(json, "title"),
                   .note = text_at(json, "note"),
                   .head = text_at(json, "head"),
                   .columns = {},
                   .rows = {}};
  for (const Json& column : json.at("columns"))
    table.columns.push_back(
        {text_at(column, "name"), column.contains("unit") ? text_at(column, "unit") : "1"});
  for (const Json& row : json.at("rows")) {
    TableBlock::Row made{text_at(row, "name"), {}};
    for (const Json& cell : row.at("cells")) made.cells.push_back(cell_of(cell));
    made.cells.resize(table.columns.size(), TableBlock::Cell(std::string()));
    table.rows.push_back(std::move(made));
  }
  return table;
}

Chart chart_of(const Json& json) {
  const auto axis = [&](const char* key) {
    const Json& from = json.at(key);
    Axis made{text_at(from, "name"), from.contains("unit") ? text_at(from, "unit") : "1"};
    if (from.value("log", false)) made.scale = AxisScale::kLogarithmic;
    return made;
  };
  Chart chart{text_at(json, "title"), text_at(json, "text"), axis("x"), axis("y"), {}};
  for (const Json& from : json.at("series")) {
    PointSeries series{.name = text_at(from, "name"), .mark = Mark::kLine};
    for (const Json& x : from.at("x")) series.x.push_back(number_of(x));
    for (const Json& y : from.at("y")) series.y.push_back(number_of(y));
    const std::size_t size = std::min(series.x.size(), series.y.size());
    series.x.resize(size);
    series.y.resize(size);
    chart.series.emplace_back(std::move(series));
  }
  return chart;
}

// Mosaics of one scene in DN above black, as float files.
PicturesBlock pictures_block(const Json& json, const std::filesystem::path& folder) {
  const double white = json.at("white_dn").get<double>();
  // The steps that pictures are stored in are parts of it.
  if (!(white >= std::numeric_limits<float>::min() && white <= std::numeric_limits<float>::max()))
    throw InputError(fmt::format("pictures \"{}\"", text_at(json, "title")),
                     fmt::format("white_dn is {:g}", white),
                     "give the white level above black, which is above 0");
  PicturesBlock block{.title = text_at(json, "title"),
                      .text = text_at(json, "text"),
                      .layout = SensorLayout::named(json.at("layout").get<std::string>()),
                      .white_dn = white};
  FrameOptions options;
  options.layout = block.layout;
  for (const Json& from : json.at("files")) {
    const std::filesystem::path file = folder / from.at("file").get<std::string>();
    RawFrame frame = load_frame(file, options);
    if (block.pictures.empty()) {
      block.rows = frame.dn.rows();
      block.cols = frame.dn.cols();
    } else if (frame.dn.rows() != block.rows || frame.dn.cols() != block.cols) {
      throw InputError(file.string(), "has another size than the pictures beside it",
                       "list pictures of one scene");
    }
    block.pictures.push_back({text_at(from, "name"), std::move(frame.dn), 1});
  }
  return block;
}

struct Metric {
  const char *group, *key, *name, *unit;
};
constexpr Metric kMetrics[] = {{"image", "psnr", "image PSNR", "dB"},
                               {"image", "ssim", "image SSIM", "1"},
                               {"dolp", "psnr", "DoLP PSNR", "dB"},
                               {"aolp", "psnr", "AoLP PSNR", "dB"},
                               {"aolp", "circular_deg", "AoLP circular error", "deg"}};

// What evaluate had no value for is null, what it did not know yet absent. Of other types nlohmann
// throws: dashes in the table would say that the pictures could not be compared.
double metric_of(const Json& result, const Metric& metric) {
  if (!result.contains(metric.group)) return Measured::kNone;
  const Json& group = result.at(metric.group);
  if (metric.key == std::string_view("psnr") && group.contains("equal") &&
      group.at("equal") == true)
    return std::numeric_limits<double>::infinity();
  if (group.is_object() && !group.contains(metric.key)) return Measured::kNone;
  const Json& value = group.at(metric.key);
  return value.is_null() ? Measured::kNone : value.get<double>();
}

bool has_metric(const std::vector<Json>& results, const Metric& metric) {
  return std::any_of(results.begin(), results.end(),
                     [&](const Json& result) { return std::isfinite(metric_of(result, metric)); });
}

// Those of the picture always; those of polarization where any picture has any, as their absence
// means equal pictures there, but no polarization elsewhere.
std::vector<Metric> metrics_of(const std::vector<Json>& results) {
  const auto of_picture = [](const Metric& m) { return std::string_view(m.group) == "image"; };
  const bool polarized = std::any_of(
      std::begin(kMetrics), std::end(kMetrics),
      [&](const Metric& metric) { return !of_picture(metric) && has_metric(results, metric); });
  std::vector<Metric> metrics;
  std::copy_if(std::begin(kMetrics), std::end(kMetrics), std::back_inserter(metrics),
               [&](const Metric& metric) { return polarized || of_picture(metric); });
  return metrics;
}

// One bar per picture.
ChartsBlock bars_of(const Metric& metric, const std::vector<Json>& results,
                    const std::vector<std::string>& names) {
  Chart chart{metric.name,
              "One bar per picture.",
              {"picture", "1", AxisScale::kCategory, names},
              {metric.name, metric.unit},
              {}};
  PointSeries bars{.name = metric.name, .mark = Mark::kBars};
  for (std::size_t i = 0; i < results.size(); ++i) {
    bars.x.push_back(static_cast<double>(i));
    bars.y.push_back(metric_of(results[i], metric));
  }
  chart.series.emplace_back(std::move(bars));
  return {"", {{"", std::move(chart)}}};
}

// The last `parts` parts of a path.
std::filesystem::path end_of(const std::filesystem::path& path, std::ptrdiff_t parts) {
  std::filesystem::path end;
  const std::ptrdiff_t all = std::distance(path.begin(), path.end());
  for (auto part = std::next(path.begin(), std::max(all - parts, std::ptrdiff_t{0}));
       part != path.end(); ++part)
    end /= *part;
  return end;
}

// A path's file name, and of its folders as many as tell it from the others.
std::string telling_end(const std::string& path, const std::vector<std::string>& all) {
  std::ptrdiff_t parts = 1;
  const auto is_mistaken = [&](const std::string& other) {
    return other != path && end_of(other, parts) == end_of(path, parts);
  };
  while (std::ranges::any_of(all, is_mistaken) && end_of(path, parts) != path) ++parts;
  return end_of(path, parts).string();
}

}  // namespace

Json record_table(const std::string& title, const std::string& note, const std::string& head,
                  const std::vector<std::pair<std::string, std::string>>& columns) {
  Json table{{"title", title},
             {"note", note},
             {"head", head},
             {"columns", Json::array()},
             {"rows", Json::array()}};
  for (const auto& [name, unit] : columns)
    table["columns"].push_back({{"name", name}, {"unit", unit}});
  return table;
}

void add_record_row(Json& table, const std::string& name, const Json& cells) {
  table["rows"].push_back({{"name", name}, {"cells", cells}});
}

NoticesBlock warning_notices(const Json& run) {
  NoticesBlock notices;
  if (run.contains("warnings"))
    for (const Json& warning : run.at("warnings"))
      notices.items.push_back({NoticeLevel::kWarning, warning.get<std::string>()});
  return notices;
}

std::vector<Section> evaluation_sections(const Json& evaluation, const std::string& prefix) {
  std::vector<Json> results;
  if (evaluation.contains("results"))
    for (const Json& result : evaluation.at("results")) results.push_back(result);
  else
    results.push_back(evaluation);
  const std::vector<Metric> metrics = metrics_of(results);
  TableBlock table{
      .title = "Against the reference", .note = "", .head = "picture", .columns = {}, .rows = {}};
  if (metrics.size() == std::size(kMetrics))
    table.note =
        "PSNR of AoLP is the papers' linear one, which punishes 179° against 1°; the circular "
        "error is the root mean square in degrees, weighted by DoLP.";
  for (const Metric& metric : metrics) table.columns.push_back({metric.name, metric.unit});
  std::vector<std::string> tests, names;
  for (const Json& result : results) tests.push_back(text_at(result, "test"));
  for (const Json& result : results) {
    const std::string name = text_at(result, "test");
    names.push_back(name.empty() ? "test" : telling_end(name, tests));
    TableBlock::Row row{names.back(), {}};
    for (const Metric& metric : metrics)
      row.cells.emplace_back(Measured{metric_of(result, metric), Measured::kNone});
    table.rows.push_back(std::move(row));
  }
  Section section{prefix + "evaluation",
                  prefix.empty() ? "Results" : "Evaluation",
                  text_at(evaluation, "reference"),
                  {}};
  NoticesBlock warnings = warning_notices(evaluation);
  if (!warnings.items.empty()) section.blocks.emplace_back(std::move(warnings));
  section.blocks.emplace_back(std::move(table));
  if (results.size() > 1)
    for (const Metric& metric : metrics)
      if (has_metric(results, metric)) section.blocks.emplace_back(bars_of(metric, results, names));
  return {section};
}

std::vector<Section> record_sections(const Json& record, const std::filesystem::path& folder,
                                     const std::string& prefix) {
  Section section{prefix + "record",
                  prefix.empty() ? "Results" : text_at(record, "title"),
                  text_at(record, "text"),
                  {}};
  if (record.contains("warnings") || record.contains("notes")) {
    NoticesBlock notices = warning_notices(record);
    for (const Json& note : record.value("notes", Json::array()))
      notices.items.push_back({NoticeLevel::kNote, note.get<std::string>()});
    if (!notices.items.empty()) section.blocks.emplace_back(std::move(notices));
  }
  if (record.contains("tables"))
    for (const Json& table : record.at("tables")) section.blocks.emplace_back(table_block(table));
  if (record.contains("charts"))
    for (const Json& chart : record.at("charts"))
      section.blocks.emplace_back(ChartsBlock{"", {{"", chart_of(chart)}}});
  if (record.contains("pictures"))
    for (const Json& pictures : record.at("pictures"))
      section.blocks.emplace_back(pictures_block(pictures, folder));
  return {section};
}

void write_evaluation_report(const Json& evaluation, const std::filesystem::path& path,
                             bool force) {
  write_report(
      make_report("Evaluation", text_at(evaluation, "reference"), evaluation_sections(evaluation)),
      path, {.force = force});
}

void write_record_report(const Json& record, const std::filesystem::path& path, bool force,
                         const std::filesystem::path& folder) {
  Json whole = record;
  for (const std::string& line : take_warnings()) whole["warnings"].push_back(line);
  write_report(make_report(text_at(record, "title"), {}, record_sections(whole, folder)), path,
               {.force = force});
}

Report make_report(const std::string& title, const std::string& subtitle,
                   std::vector<Section> sections) {
  return {.title = title,
          .subtitle = subtitle,
          .program = "malus " MALUS_VERSION,
          .sections = std::move(sections)};
}

}  // namespace malus::app
