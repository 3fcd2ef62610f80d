// malus info: what is in these files, and do they look like what they are declared to be?
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/image/frame_statistics.h"
#include "malus/io/frame_file.h"
#include "malus/io/gain_json.h"
#include "malus/noise/same_sensor.h"
#include "malus/polar/layout_check.h"

#include <filesystem>
#include <memory>
#include <vector>

#include "program.h"
#include "raw_options.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;

struct Findings {
  FrameInfo info;
  std::vector<ChannelSummary> channels;
  Estimate<ValueGrid> grid = Undecided{"not looked at"};
  LayoutCheck check;
  std::vector<std::string> warnings;
};

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
      findings.warnings.push_back(
          fmt::format("the largest value {:g} fits in {} bits; if the sensor has as many, give "
                      "--white {}",
                      largest, guess->bits, guess->white_dn));
  if (const std::string note = declaration_note(frame); !note.empty())
    findings.warnings.push_back(note);
  if (const std::string complaint = layout_complaint(frame.layout, findings.check);
      !complaint.empty())
    findings.warnings.push_back(complaint);
}

Findings inspect(const std::filesystem::path& path, const FrameOptions& options) {
  Findings findings;
  findings.info = load_frame_info(path, options);
  RawFrame& frame = findings.info.frame;
  findings.channels = summarize(frame);
  if (frame.bits > 0) findings.grid = value_grid(frame.dn);
  RawFrame above_black = frame;
  subtract_black(above_black);
  findings.check = check_layout(above_black.dn);
  collect_warnings(findings);
  return findings;
}

std::string layout_check_text(const Findings& findings) {
  const LayoutCheck& check = findings.check;
  const bool polarized = declared_pairing(findings.info.frame.layout).has_value();
  if (!polarized && findings.info.frame.layout_known) return "no polarizers declared";
  const std::string scores =
      fmt::format("crossed-pair mismatch: diagonal {:.4f}, row {:.4f}, column {:.4f}",
                  check.diagonal, check.row, check.column);
  if (!check.decided()) return scores + " (the scene decides nothing)";
  const std::string winner =
      fmt::format("{}; {} wins by {:.2f}", scores, pairing_name(check.winner()), check.margin());
  if (!polarized)
    return winner +
           " (of a polarization sensor, which needs --layout polar-mono or polar-bayer-rggb)";
  const bool agrees = check.winner() == *declared_pairing(findings.info.frame.layout);
  return winner + (agrees ? ", as declared" : ", NOT as declared");
}

std::string black_text(const RawFrame& frame) {
  bool uniform = true;
  for (const double black : frame.black_dn) uniform = uniform && black == frame.black_dn[0];
  if (uniform) return fmt::format("{:g} DN", frame.black_dn[0]);
  std::vector<std::string> parts;
  for (const double black : frame.black_dn) parts.push_back(fmt::format("{:g}", black));
  return joined(parts, " ") + " DN";
}

std::string findings_text(const Findings& findings) {
  const FrameInfo& info = findings.info;
  const RawFrame& frame = info.frame;
  const auto origin = [](bool known) { return known ? "" : "  (assumed)"; };
  std::string out = fmt::format("{}\n", frame.source);
  const auto line = [&](std::string_view name, const std::string& value) {
    out += fmt::format("  {:<14}{}\n", name, value);
  };
  line("size", fmt::format("{} x {} pixels, {}, {}", info.cols, info.rows, info.format,
                           frame.bits > 0 ? fmt::format("{} bits in {}", frame.bits, info.sample)
                                          : info.sample));
  if (!info.camera.empty()) line("camera", info.camera);
  line("layout", frame.layout.name() + origin(frame.layout_known));
  line("black", black_text(frame) + origin(frame.black_known));
  line("white", fmt::format("{:g} DN{}", frame.white_dn, origin(frame.white_known)));
  line("gain", frame.gain.text());
  line("exposure", frame.exposure_s ? fmt::format("{:g} s", *frame.exposure_s) : "unknown");
  line("layout check", layout_check_text(findings));
  out += fmt::format("\n  {:<8}{:>11}{:>11}{:>11}{:>13}{:>13}\n", "channel", "mean/DN", "min/DN",
                     "max/DN", "saturated/%", "noise sd/DN");
  for (std::size_t i = 0; i < findings.channels.size(); ++i) {
    const ChannelSummary& c = findings.channels[i];
    out += fmt::format("  {:<8}{:>11.2f}{:>11g}{:>11g}{:>13.3f}{:>13}\n",
                       frame.layout.channel_name(static_cast<int>(i)), c.mean_dn, c.minimum_dn,
                       c.maximum_dn, 100.0 * c.saturated_share,
                       c.noise_dn ? fmt::format("{:.3f}", *c.noise_dn) : "undecided");
  }
  for (const auto& channel : findings.channels)
    if (!channel.noise_dn) {
      out += fmt::format("  noise undecided: {}\n", channel.noise_dn.reason());
      break;
    }
  return out;
}

Json channel_columns(const std::vector<ChannelSummary>& channels) {
  Json mean, minimum, maximum, saturated, below, noise;
  for (const ChannelSummary& c : channels) {
    mean.push_back(c.mean_dn);
    minimum.push_back(c.minimum_dn);
    maximum.push_back(c.maximum_dn);
    saturated.push_back(c.saturated_share);
    below.push_back(c.below_black_share);
    noise.push_back(c.noise_dn ? Json(*c.noise_dn) : Json());
  }
  return {{"mean", {{"value", mean}, {"unit", "DN"}}},
          {"minimum", {{"value", minimum}, {"unit", "DN"}}},
          {"maximum", {{"value", maximum}, {"unit", "DN"}}},
          {"saturated_share", {{"value", saturated}, {"unit", "1"}}},
          {"below_black_share", {{"value", below}, {"unit", "1"}}},
          {"noise_sd", {{"value", noise}, {"unit", "DN"}}}};
}

Json findings_json(const Findings& findings) {
  const FrameInfo& info = findings.info;
  const RawFrame& frame = info.frame;
  Json json = {{"file", frame.source},
               {"rows", info.rows},
               {"cols", info.cols},
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

}  // namespace

void add_info(CLI::App& app, Common& common) {
  struct Arguments {
    std::vector<std::filesystem::path> files;
    RawOptions raw;
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* command = add_command(
      app, common, "info", "Describe raw frames: size, levels, noise, layout check",
      [arguments, &common] {
        const FrameOptions options = arguments->raw.resolve();
        Json frames = Json::array();
        std::string text;
        for (const auto& file : arguments->files) {
          const Findings findings = inspect(file, options);
          for (const auto& warning : findings.warnings)
            warn(fmt::format("{}: {}", file.string(), warning));
          frames.push_back(findings_json(findings));
          if (!text.empty()) text += '\n';
          text += findings_text(findings);
        }
        print_result(common, frames.size() == 1 ? frames[0] : Json{{"frames", frames}}, text);
      });
  command->add_option("FILE", arguments->files, "raw frames")->required();
  arguments->raw.add_to(*command);
}

}  // namespace malus::app
