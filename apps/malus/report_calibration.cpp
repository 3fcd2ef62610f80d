#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/calibrate/warnings_of_gains.h"
#include "malus/noise/data_sheet.h"
#include "malus/noise/rounding.h"
#include "malus/report/write_report.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

#include "report_pages.h"
#include "report_plots.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

// A built-in model that no camera stands behind says so in its origin.
bool is_invented(const NoiseModel& model) { return model.origin.starts_with("SIMULATED"); }

bool is_measured(const NoiseModel& model) {
  return !model.dark_frames.empty() ||
         std::any_of(model.physics.begin(), model.physics.end(),
                     [](const PhysicsCalibration& p) { return p.bias_frames > 0; }) ||
         std::any_of(model.gaussian.begin(), model.gaussian.end(),
                     [](const GaussianCalibration& g) { return g.levels > 0; }) ||
         std::any_of(model.nonparametric.begin(), model.nonparametric.end(),
                     [](const NonparametricCalibration& n) { return n.frames > 0; });
}

// What the calibration warned about, or that there was nothing.
NoticesBlock calibration_warnings(const NoiseModel& model) {
  NoticesBlock notices;
  const auto add = [&](const std::string& place, const std::vector<std::string>& warnings) {
    for (const std::string& warning : warnings)
      notices.items.push_back({NoticeLevel::kWarning, place + warning});
  };
  if (is_invented(model)) add("", {"Invented to be plausible, measured on no camera."});
  add("", model.warnings);
  add("", warnings_of_gains(model));
  if (!notices.items.empty()) return notices;
  if (is_measured(model))
    notices.items.push_back({NoticeLevel::kGood, "The calibration has nothing to warn about."});
  else
    notices.items.push_back(
        {NoticeLevel::kNote,
         "Nothing here was measured from frames: the numbers are published or computed ones."});
  return notices;
}

bool knows_light_of_exposures(const NoiseModel& model, const PhysicsCalibration& p) {
  for (int channel = 0; channel < model.layout.channels(); ++channel)
    if (!exposure_tells_light(p.transfer, channel, saturation_level_dn(model, p, channel)))
      return false;
  return true;
}

NoticesBlock findings(const NoiseModel& model) {
  NoticesBlock notices = calibration_warnings(model);
  const auto add = [&](NoticeLevel level, const std::string& text) {
    notices.items.push_back({level, text});
  };
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
          fmt::format("{}rows drift slowly, {}.", gain_prefix(p.gain), text_of(p.row_drift)));
  for (const PhysicsCalibration& p : model.physics)
    if (!knows_light_of_exposures(model, p))
      add(NoticeLevel::kNote,
          gain_prefix(p.gain) +
              "Levels of one exposure differ in their light, so the exposure does not tell it: "
              "linearity is not judged.");
  if (!model.defects.empty())
    add(NoticeLevel::kNote,
        counted_are(std::ssize(model.defects), "defect pixel") + " listed in the model.");
  return notices;
}

Measured measured_mean(const Quantity& quantity) {
  const ChannelMean mean = channel_mean(quantity);
  return {mean.value, mean.standard_error};
}

// ", mean of the channels", or of how many, where the others' value is not known.
std::string mean_of_what(const Quantity& quantity) {
  const auto all = std::ssize(quantity.value);
  const auto known = std::count_if(quantity.value.begin(), quantity.value.end(),
                                   [](double value) { return std::isfinite(value); });
  if (all == 1) return "";
  if (known == all || known == 0) return ", mean of the channels";
  return fmt::format(", mean of {} of {} channels", known, all);
}

FiguresBlock key_figures(const NoiseModel& model) {
  FiguresBlock figures;
  const PhysicsCalibration& p = model.physics.front();
  const std::string gain = p.gain.decibel() ? p.gain.text() : "camera gain not told";
  for (const Quantity& quantity : data_sheet(model, p))
    if (quantity.name == "overall_gain" || quantity.name == "read_noise" ||
        quantity.name == "saturation" || quantity.name == "dynamic_range")
      figures.items.push_back({quantity.description, quantity.symbol, quantity.unit,
                               gain + mean_of_what(quantity), measured_mean(quantity)});
  return figures;
}

// What data_sheet states then is no measurement, beside a read noise that is one.
std::string limit_of_dark_noise(const NoiseModel& model) {
  const double least_dn = std::sqrt(kLeastDarkVariance) * model.quantization_dn;
  std::vector<std::string> gains;
  for (const PhysicsCalibration& p : model.physics)
    if (std::any_of(p.temporal_sd_dark_dn.begin(), p.temporal_sd_dark_dn.end(),
                    [=](double sd_dn) { return sd_dn < least_dn; }))
      gains.push_back(p.gain.decibel() ? p.gain.text() : "this gain");
  if (gains.empty()) return "";
  return fmt::format(
      " At {} the converter's step hides the dark noise of channels: theirs is the standard's "
      "limit, so the true dark noise and threshold are at most these, and the dynamic range at "
      "least this.",
      joined(gains));
}

TableBlock sheet_over_gains(const NoiseModel& model) {
  const bool below_white =
      std::any_of(model.physics.begin(), model.physics.end(), [](const PhysicsCalibration& p) {
        return std::any_of(p.transfer.begin(), p.transfer.end(),
                           [](const PhotonTransferPoint& point) { return point.saturated; });
      });
  TableBlock table{.title = "Data sheet",
                   .note = fmt::format(
                       "Terms of the EMVA Standard 1288, means of the channels. Saturation is {}. "
                       "Quantum efficiency is not measured, so the threshold is in electrons.{}",
                       below_white ? "where the temporal noise is largest, and the mean is of the "
                                     "channels whose flats get there; at gains where none does it "
                                     "is the white level's"
                                   : "the white level's",
                       limit_of_dark_noise(model)),
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
      table.rows[i].cells.emplace_back(measured_mean(sheet[i]));
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
  const auto add_values = [&](const char* symbol, const char* unit, std::vector<double> value,
                              std::vector<double> error) {
    if (!value.empty())
      list.push_back({symbol, symbol, unit, "", std::move(value), std::move(error)});
  };
  const auto percent = [](std::vector<double> share) {
    for (double& value : share) value *= 100;
    return share;
  };
  add_values("σ_dark", "DN", p.temporal_sd_dark_dn, p.temporal_sd_dark_stderr_dn);
  add_values("DSNU", "DN", p.dsnu_dn, p.dsnu_stderr_dn);
  add_values("PRNU", "%", percent(p.prnu), percent(p.prnu_stderr));
  add_values("σ_read", "e-", read_noise_e(p), read_noise_stderr_e(p));
  add_values("intercept of K's line", "DN²", p.K_intercept_dn2, p.K_intercept_stderr_dn2);
  return list;
}

// A name for the title.
std::string sensor_name(const NoiseModel& model) {
  return model.sensor.empty() ? "an unnamed sensor" : model.sensor;
}

// "Lucid Phoenix, mono, one gain, from session.toml"
std::string summary_lead(const NoiseModel& model) {
  const std::size_t gains = std::max({model.physics.size(), model.gaussian.size(),
                                      model.nonparametric.size(), model.dark_frames.size()});
  std::string lead = model.sensor.empty() ? "" : model.sensor + ", ";
  lead += model.layout.name() + (gains == 1 ? ", one gain" : fmt::format(", {} gains", gains));
  constexpr std::string_view kSession = "session ";
  if (model.origin.starts_with(kSession))
    lead += ", from " + model.origin.substr(kSession.size());
  else if (!model.origin.empty())
    lead += ". " + model.origin;
  return lead;
}

// "20", or "8 to 20" where the gains differ.
std::string count_range(const std::vector<int>& counts, std::string_view noun) {
  const auto [low, high] = std::minmax_element(counts.begin(), counts.end());
  return (*low == *high ? "" : fmt::format("{} to ", *low)) + counted(*high, noun);
}

// ", exposures 0.1 to 50 ms"; empty where none is known.
std::string exposures_text(const NoiseModel& model) {
  double low_s = std::numeric_limits<double>::infinity(), high_s = 0;
  for (const PhysicsCalibration& p : model.physics)
    for (const PhotonTransferPoint& point : p.transfer)
      if (point.exposure_s > 0) {
        low_s = std::min(low_s, point.exposure_s);
        high_s = std::max(high_s, point.exposure_s);
      }
  if (high_s == 0) return "";
  const double factor = high_s < 1 ? 1000 : 1;
  const char* unit = high_s < 1 ? "ms" : "s";
  return low_s == high_s
             ? fmt::format(" of {:.4g} {}", factor * low_s, unit)
             : fmt::format(" of {:.4g} to {:.4g} {}", factor * low_s, factor * high_s, unit);
}

// What K and the read noise were measured from: ", 20 bias frames and 12 flat levels of 1 to 50 ms,
// flats used up to 70 % of white"; empty for a model that is not measured.
std::string conditions_text(const NoiseModel& model) {
  std::vector<int> bias, flats;
  for (const PhysicsCalibration& p : model.physics) {
    bias.push_back(p.bias_frames);
    flats.push_back(p.flat_levels);
  }
  if (bias.empty() || *std::max_element(bias.begin(), bias.end()) == 0) return "";
  std::string text = fmt::format(", {}{}", count_range(bias, "bias frame"),
                                 model.physics.size() > 1 ? " per gain" : "");
  if (*std::max_element(flats.begin(), flats.end()) == 0) return text + ", no flat frames";
  text += ", " + count_range(flats, "flat level") + exposures_text(model);
  if (model.saturation_limit > 0)
    text += fmt::format(", levels used up to {:.3g} % of the range", 100 * model.saturation_limit);
  return text;
}

Section summary(const NoiseModel& model) {
  Section section{"summary", "Summary", summary_lead(model), {}};
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
      {"response", "Signal to noise and linearity",
       "What the light becomes: how far above the noise, and how straight.", response_plots(model)},
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
  return fmt::format("{}, {}{}", model.layout.name(), counted(model.layout.channels(), "channel"),
                     conditions_text(model));
}

void write_calibration_report(const NoiseModel& model, const std::filesystem::path& path,
                              bool force) {
  write_report(make_report(calibration_title(model), calibration_subtitle(model),
                           calibration_sections(model)),
               path, {.force = force});
}

}  // namespace malus::app
