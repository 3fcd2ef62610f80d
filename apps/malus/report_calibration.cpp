#include "malus/base/statistics.h"
#include "malus/noise/data_sheet.h"
#include "malus/report/write_report.h"

#include <algorithm>
#include <cmath>

#include "report_pages.h"
#include "report_plots.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

NoticesBlock findings(const NoiseModel& model) {
  NoticesBlock notices;
  const auto add = [&](NoticeLevel level, const std::string& text) {
    notices.items.push_back({level, text});
  };
  for (const PhysicsCalibration& p : model.physics)
    for (const std::string& warning : p.warnings)
      add(NoticeLevel::kWarning, p.gain.text() + ": " + warning);
  for (const GaussianCalibration& g : model.gaussian)
    for (const std::string& warning : g.warnings)
      add(NoticeLevel::kWarning, g.gain.text() + ", Gaussian: " + warning);
  for (const NonparametricCalibration& n : model.nonparametric)
    for (const std::string& warning : n.warnings)
      add(NoticeLevel::kWarning, n.gain.text() + ", non-parametric: " + warning);
  if (notices.items.empty()) add(NoticeLevel::kGood, "The calibration has nothing to warn about.");
  if (model.joint)
    for (const std::string& text : model.joint->notes) add(NoticeLevel::kNote, text);
  add(NoticeLevel::kNote, model.row_group == 1
                              ? fmt::format("Every mosaic row has its own draw of row noise ({}).",
                                            model.row_group_origin)
                              : fmt::format("{} mosaic rows share one draw of row noise ({}).",
                                            model.row_group, model.row_group_origin));
  for (const PhysicsCalibration& p : model.physics)
    if (!p.row_drift.drift.white())
      add(NoticeLevel::kNote,
          fmt::format("{}: rows drift slowly, {}.", p.gain.text(), text_of(p.row_drift)));
  if (!model.defects.empty())
    add(NoticeLevel::kNote,
        fmt::format("{} defect pixels are listed in the model.", model.defects.size()));
  return notices;
}

// Mean over the channels; the standard error takes the channels' errors as independent.
Measured channel_mean(const Quantity& quantity) {
  Moments values;
  double squares = 0;
  for (std::size_t c = 0; c < quantity.value.size(); ++c) {
    if (!std::isfinite(quantity.value[c])) continue;
    values.add(quantity.value[c]);
    squares += c < quantity.standard_error.size() ? std::pow(quantity.standard_error[c], 2)
                                                  : Measured::kNone;
  }
  if (values.count() == 0) return {Measured::kNone, Measured::kNone};
  return {values.mean(), std::sqrt(squares) / static_cast<double>(values.count())};
}

FiguresBlock key_figures(const NoiseModel& model) {
  FiguresBlock figures;
  const PhysicsCalibration& p = model.physics.front();
  const std::string note = fmt::format("{}{}", p.gain.text(),
                                       model.layout.channels() > 1 ? ", mean of the channels" : "");
  for (const Quantity& quantity : data_sheet(model, p))
    if (quantity.name == "overall_gain" || quantity.name == "read_noise" ||
        quantity.name == "saturation" || quantity.name == "dynamic_range")
      figures.items.push_back(
          {quantity.description, quantity.symbol, quantity.unit, note, channel_mean(quantity)});
  return figures;
}

TableBlock sheet_over_gains(const NoiseModel& model) {
  TableBlock table{.title = "Data sheet",
                   .note =
                       "Terms of the EMVA Standard 1288, means of the channels. Saturation is "
                       "the white level's. Quantum efficiency is not measured, so the "
                       "threshold is in electrons.",
                   .head = "quantity",
                   .columns = {},
                   .rows = {}};
  for (const PhysicsCalibration& p : model.physics) {
    const std::vector<Quantity> sheet = data_sheet(model, p);
    table.columns.push_back({p.gain.decibel() ? p.gain.text() : "value", "1"});
    if (table.rows.empty())
      for (const Quantity& quantity : sheet)
        table.rows.push_back(
            {fmt::format("{}, {} [{}]", quantity.description, quantity.symbol, quantity.unit), {}});
    for (std::size_t i = 0; i < sheet.size(); ++i)
      table.rows[i].cells.emplace_back(channel_mean(sheet[i]));
  }
  return table;
}

std::vector<Quantity> parameters(const PhysicsCalibration& p) {
  std::vector<Quantity> list;
  const auto add = [&](const std::string& symbol, const std::string& unit,
                       const ChannelStatistics& s) {
    if (!s.mean.empty()) list.push_back({symbol, symbol, unit, "", s.mean, s.standard_error});
  };
  add("K", "DN/e-", p.K);
  add("μ", "DN", p.mu);
  add("σ_b", "DN", p.sigma_row);
  add("λ", "1", p.lambda);
  add("σ_TL", "DN", p.sigma_tl);
  add("σ_column", "DN", p.sigma_column);
  list.push_back({"sd", "σ_dark", "DN", "", p.temporal_sd_dark_dn, p.temporal_sd_dark_stderr_dn});
  return list;
}

// A name for the title.
std::string sensor_name(const NoiseModel& model) {
  return model.sensor.empty() ? "an unnamed sensor" : model.sensor;
}

Section summary(const NoiseModel& model) {
  const std::size_t gains = std::max({model.physics.size(), model.gaussian.size(),
                                      model.nonparametric.size(), model.dark_frames.size()});
  Section section{"summary",
                  "Summary",
                  fmt::format("{}, {}, {} gain{}. {}", sensor_name(model), model.layout.name(),
                              gains, gains == 1 ? "" : "s", model.origin),
                  {}};
  section.blocks.emplace_back(findings(model));
  if (model.physics.empty()) return section;
  section.blocks.emplace_back(key_figures(model));
  section.blocks.emplace_back(sheet_over_gains(model));
  return section;
}

Section per_channel(const NoiseModel& model) {
  Section section{"parameters",
                  "Parameters per channel",
                  "Means over the bias frames with their standard errors; the model file holds the "
                  "same numbers.",
                  {}};
  for (const PhysicsCalibration& p : model.physics)
    section.blocks.emplace_back(
        channel_table(title_at("Parameters", p.gain), model.layout, parameters(p)));
  for (const GaussianCalibration& g : model.gaussian)
    section.blocks.emplace_back(
        channel_table("Heteroscedastic Gaussian, " + g.gain.text(), model.layout,
                      {{"slope", "slope", "DN", "", g.slope_dn, g.slope_stderr_dn},
                       {"offset", "offset", "DN^2", "", g.offset_dn2, g.offset_stderr_dn2}}));
  return section;
}

}  // namespace

std::vector<Section> calibration_sections(const NoiseModel& model, const std::string& prefix) {
  std::vector<Section> sections = {
      summary(model),
      {"transfer", "Photon transfer",
       "The gain of every channel from the growth of temporal variance with the signal.",
       transfer_plots(model)},
      {"bias", "Bias frames", "How the parameters vary from frame to frame.", box_plots(model)},
      {"correlation", "Correlations", "Which channels vary together.", correlation_plots(model)},
      {"laws", "Over gain", "The joint model that gives parameters at gains in between.",
       law_plots(model)},
      {"distribution", "Read noise", "How well the fitted laws describe the dark noise.",
       distribution_plots(model)},
      {"levels", "Noise per level", "The non-parametric model.", level_plots(model)},
      {"pattern", "Fixed pattern", "What stays from frame to frame.", pattern_plots(model)},
      per_channel(model)};
  std::erase_if(sections, [](const Section& section) { return section.blocks.empty(); });
  for (Section& section : sections) section.id = prefix + section.id;
  return sections;
}

std::string calibration_title(const NoiseModel& model) {
  return "Calibration of " + sensor_name(model);
}

std::string calibration_subtitle(const NoiseModel& model) {
  const int channels = model.layout.channels();
  return fmt::format("{}, {} channel{}", model.layout.name(), channels, channels == 1 ? "" : "s");
}

void write_calibration_report(const NoiseModel& model, const std::filesystem::path& path,
                              bool force) {
  write_report(make_report(calibration_title(model), calibration_subtitle(model),
                           calibration_sections(model)),
               path, {.force = force});
}

}  // namespace malus::app
