// malus info: what is in these files, and do they look like what they are declared to be?
#include "malus/base/text.h"
#include "malus/io/frame_file.h"

#include <filesystem>
#include <memory>
#include <vector>

#include "frame_findings.h"
#include "program.h"
#include "raw_options.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;

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
  if (info.frames_in_file > 1)
    line("frames", fmt::format("{} in the file; this is one of them", info.frames_in_file));
  if (!info.camera.empty()) line("camera", info.camera);
  line("layout", frame.layout.name() + origin(frame.layout_known));
  line("black", black_text(frame) + origin(frame.black_known));
  line("white", fmt::format("{:g} DN{}", frame.white_dn, origin(frame.white_known)));
  if (frame.mean_of > 1) line("mean of", fmt::format("{} frames", frame.mean_of));
  line("gain", frame.gain.text());
  line("exposure", frame.exposure_s ? fmt::format("{:g} s", *frame.exposure_s) : "unknown");
  line("layout check", layout_check_text(findings));
  out += fmt::format("\n  {:<8}{:>11}{:>11}{:>11}{:>13}{:>13}{:>11}\n", "channel", "mean/DN",
                     "min/DN", "max/DN", "saturated/%", "noise sd/DN", "at/DN");
  for (std::size_t i = 0; i < findings.channels.size(); ++i) {
    const ChannelSummary& c = findings.channels[i];
    out += fmt::format("  {:<8}{:>11.2f}{:>11g}{:>11g}{:>13.3f}{:>13}{:>11}\n",
                       frame.layout.channel_name(static_cast<int>(i)), c.mean_dn, c.minimum_dn,
                       c.maximum_dn, 100.0 * c.saturated_share,
                       c.noise_dn ? fmt::format("{:.3f}", *c.noise_dn) : "undecided",
                       c.noise_dn ? fmt::format("{:.2f}", c.noise_at_dn) : "");
  }
  for (const auto& channel : findings.channels)
    if (!channel.noise_dn) {
      out += fmt::format("  noise undecided: {}\n", channel.noise_dn.reason());
      break;
    }
  return out;
}

}  // namespace

void add_info(CLI::App& app, Common& common) {
  struct Arguments {
    std::vector<std::filesystem::path> files;
    RawOptions raw;
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* command = add_command(
      app, common, "info", "Describe raw frames: size, levels, noise, layout check", {},
      [arguments, &common] {
        const FrameOptions options = arguments->raw.resolve();
        Json frames = Json::array();
        std::string text;
        const auto work = [&] {
          for (const auto& file : arguments->files) {
            const auto frame = first_frame(file, options.raw_format.has_value());
            const Findings findings = findings_of(load_frame_info(frame, options));
            for (const auto& warning : findings.warnings)
              warn(fmt::format("{}: {}", frame.string(), warning));
            frames.push_back(findings_json(findings));
            if (!text.empty()) text += '\n';
            text += findings_text(findings);
          }
        };
        work_and_print(work, [&] { print_frames(common, frames, arguments->files.size(), text); });
      });
  command
      ->add_option("FILE", arguments->files,
                   "raw frames; of a stack the first, or the one that is named: stack.tif[3]")
      ->required();
  arguments->raw.add_to(*command, {.dark = true});
}

}  // namespace malus::app
