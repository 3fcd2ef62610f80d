#include "frame_findings.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/io/gain_json.h"
#include "malus/noise/same_sensor.h"

#include <utility>

#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;

std::int64_t nonfinite_pixels(const Findings& findings) {
  std::int64_t total = 0;
  for (const auto& channel : findings.channels) total += channel.nonfinite;
  return total;
}

double largest_value(const Findings& findings) {
  double largest = -1.0;
  for (const auto& channel : findings.channels)
    if (channel.maximum_dn > largest) largest = channel.maximum_dn;
  return largest;
}

// "multiples of 16", "16 n + 15", "16 n + 15 to 16".
std::string grid_text(const ValueGrid& grid) {
  if (grid.offset == 0 && grid.spread == 0) return fmt::format("multiples of {}", grid.step);
  return fmt::format("{} n + {}{}", grid.step, grid.offset,
                     grid.spread > 0 ? fmt::format(" to {}", grid.offset + grid.spread) : "");
}

void collect_warnings(Findings& findings) {
  const RawFrame& frame = findings.info.frame;
  if (const auto count = nonfinite_pixels(findings); count > 0)
    findings.warnings.push_back(counted_are(count, "pixel") + " NaN or infinite");
  if (findings.grid && findings.grid->step > 1)
    findings.warnings.push_back(fmt::format(
        "all values are {}: the data are scaled up, {} of {} levels are used",
        grid_text(*findings.grid), (1 << frame.bits) / findings.grid->step, 1 << frame.bits));
  const double largest = largest_value(findings);
  if (!frame.white_known && findings.grid)
    if (const auto guess = converter_guess(frame.bits, largest, *findings.grid))
      findings.warnings.push_back(fmt::format(
          "the largest value {:g} fits in {} bits; if the sensor has as many, give {}", largest,
          guess->bits, setting("white", static_cast<double>(guess->white_dn))));
  if (const std::string complaint = level_complaint(frame); !complaint.empty())
    findings.warnings.push_back(complaint);
  if (const std::string note = declaration_note(frame); !note.empty())
    findings.warnings.push_back(note);
  if (const std::string complaint = layout_complaint(frame.layout, findings.check);
      !complaint.empty())
    findings.warnings.push_back(complaint);
}

Json channel_columns(const std::vector<ChannelSummary>& channels) {
  Json mean, minimum, maximum, saturated, below, noise, noise_at;
  for (const ChannelSummary& c : channels) {
    mean.push_back(c.mean_dn);
    minimum.push_back(c.minimum_dn);
    maximum.push_back(c.maximum_dn);
    saturated.push_back(c.saturated_share);
    below.push_back(c.below_black_share);
    noise.push_back(c.noise_dn ? Json(*c.noise_dn) : Json());
    noise_at.push_back(c.noise_dn ? Json(c.noise_at_dn) : Json());
  }
  return {{"mean", {{"value", mean}, {"unit", "DN"}}},
          {"minimum", {{"value", minimum}, {"unit", "DN"}}},
          {"maximum", {{"value", maximum}, {"unit", "DN"}}},
          {"saturated_share", {{"value", saturated}, {"unit", "1"}}},
          {"below_black_share", {{"value", below}, {"unit", "1"}}},
          {"noise_sd", {{"value", noise}, {"unit", "DN"}}},
          {"noise_sd_at", {{"value", noise_at}, {"unit", "DN"}}}};
}

}  // namespace

Findings findings_of(FrameInfo info) {
  Findings findings;
  findings.info = std::move(info);
  RawFrame& frame = findings.info.frame;
  findings.channels = summarize(frame);
  if (frame.bits > 0) findings.grid = value_grid(frame.dn);
  RawFrame above_black = frame;
  subtract_black(above_black);
  findings.check = check_layout(above_black.dn);
  collect_warnings(findings);
  return findings;
}

nlohmann::ordered_json findings_json(const Findings& findings) {
  const FrameInfo& info = findings.info;
  const RawFrame& frame = info.frame;
  Json json = {{"file", frame.source},
               {"rows", info.rows},
               {"cols", info.cols},
               {"frames_in_file", info.frames_in_file},
               {"format", info.format},
               {"sample", info.sample},
               {"bits", frame.bits},
               {"camera", info.camera},
               {"layout", frame.layout.name()},
               {"layout_known", frame.layout_known},
               {"channels", frame.layout.channel_names()},
               {"black", frame.black_dn},
               {"black_known", frame.black_known},
               {"white", frame.white_dn},
               {"white_known", frame.white_known},
               {"exposure_s", number_or_null(frame.exposure_s)},
               {"mean_of", frame.mean_of},
               {"nonfinite_pixels", nonfinite_pixels(findings)}};
  json.update(gain_json(frame.gain));
  json.update(channel_columns(findings.channels));
  if (findings.grid)
    json["value_grid"] = {{"step", findings.grid->step},
                          {"offset", findings.grid->offset},
                          {"spread", findings.grid->spread}};
  const LayoutCheck& check = findings.check;
  const auto declared = declared_pairing(frame.layout);
  json["layout_check"] = {{"diagonal", check.diagonal},
                          {"row", check.row},
                          {"column", check.column},
                          {"winner", pairing_name(check.winner())},
                          {"margin", check.margin()},
                          {"decided", check.decided()},
                          {"declared", declared ? Json(pairing_name(*declared)) : Json()}};
  json["warnings"] = findings.warnings;
  return json;
}

}  // namespace malus::app
