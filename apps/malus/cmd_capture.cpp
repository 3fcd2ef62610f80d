#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/capture/camera.h"
#include "malus/capture/capture.h"

#include <algorithm>
#include <cstdio>
#include <limits>
#include <optional>
#include <string>

#include "live_progress.h"
#include "program.h"
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;

void print_cameras(const Common& common) {
  Json json = Json::array();
  std::string text;
  for (const auto& listed : list_cameras(true)) {
    CameraIdentity camera = listed;
    std::string formats;
    try {
      camera = describe_camera(listed.id);
      formats = joined(camera.pixel_formats, " ");
    } catch (const InputError& error) {  // held by another program: the others are listed still
      formats = error.problem();
    }
    json.push_back({{"id", camera.id},
                    {"vendor", camera.vendor},
                    {"model", camera.model},
                    {"serial", camera.serial},
                    {"protocol", camera.protocol},
                    {"address", camera.address},
                    {"pixel_formats", camera.pixel_formats}});
    text += fmt::format("{}  {} {} ({}, {})\n    {}\n", camera.id, camera.vendor, camera.model,
                        camera.serial, camera.protocol, formats);
  }
  print_result(common, {{"cameras", json}}, text);
}

// Reading goes on after Ctrl-C as if nothing had been: it begins where there is a line to read.
void wait_for_line(const Progress& progress) {
  constexpr int kPatience_ms = 200;
  pollfd input{STDIN_FILENO, POLLIN, 0};
  do check_stop(progress);
  while (poll(&input, 1, kPatience_ms) <= 0);
}

// Without a terminal nobody can answer, and a script has seen to it: the work goes on, which is
// said, for the frames are the wrong ones if nobody has.
void ask(const CaptureStep& step, const Progress& progress) {
  if (isatty(STDIN_FILENO) != 1)
    return warn(
        fmt::format("\"{}\": no terminal to answer on, the frames are taken at once", step.prompt));
  tell(step.prompt + "\n");
  tell("Press Enter when ready. ");
  wait_for_line(progress);
  for (int c = std::getchar(); c != '\n' && c != EOF; c = std::getchar()) continue;
}

// "-" for what was not measured.
std::string measured_text(const std::optional<double>& value, int decimals, double factor = 1) {
  return value ? fmt::format("{:.{}f}", factor * *value, decimals) : "-";
}

Json measured_json(const std::optional<double>& value) { return value ? Json(*value) : Json(); }

std::string live_text(const StepReport& step) {
  return fmt::format("mean {}, noise {} DN, saturated {} %, lost {}",
                     measured_text(step.mean_dn, 1), measured_text(step.temporal_sd_dn, 2),
                     measured_text(step.saturated_share, 2, 100), step.lost);
}

void take(const Common& common, const std::string& plan_path, const std::string& folder) {
  const auto plan = load_capture_plan(plan_path);
  const auto remark = std::make_shared<Remark>();
  const auto progress = make_live_progress(common, remark);
  const auto report =
      capture(plan, folder,
              {.ask = [&](const CaptureStep& step) { ask(step, *progress); },
               .watch = [&](const StepReport& step) { remark->set(live_text(step)); }},
              *progress);
  Json steps = Json::array();
  double lowest_hz = std::numeric_limits<double>::infinity(), highest_hz = 0;
  for (const auto& step : report.steps) {
    lowest_hz = std::min(lowest_hz, step.frame_rate_hz);
    highest_hz = std::max(highest_hz, step.frame_rate_hz);
  }
  std::string text =
      fmt::format("{}, {}, {}{:g} frames per second\n", report.camera, report.pixel_format,
                  lowest_hz < highest_hz ? fmt::format("{:g} to ", lowest_hz) : "", highest_hz);
  text += fmt::format("{:28} {:>6} {:>5} {:>5} {:>10} {:>12} {:>10}\n", "frames", "taken", "kept",
                      "lost", "mean [DN]", "noise sd [DN]", "saturated");
  for (const auto& step : report.steps) {
    steps.push_back({{"folder", step.step.folder()},
                     {"gain_db", step.gain_db},
                     {"exposure_s", step.exposure_s},
                     {"frame_rate_hz", step.frame_rate_hz},
                     {"taken", step.taken},
                     {"kept", step.kept},
                     {"lost", step.lost},
                     {"mean_dn", measured_json(step.mean_dn)},
                     {"temporal_sd_dn", measured_json(step.temporal_sd_dn)},
                     {"saturated_share", measured_json(step.saturated_share)}});
    text += fmt::format(
        "{:28} {:6} {:5} {:5} {:>10} {:>12} {:>9}{}\n", step.step.folder(), step.taken, step.kept,
        step.lost, measured_text(step.mean_dn, 2), measured_text(step.temporal_sd_dn, 3),
        measured_text(step.saturated_share, 2, 100), step.saturated_share ? "%" : "");
  }
  text += fmt::format("session: {}\n", report.session.string());
  print_result(common,
               {{"camera", report.camera},
                {"pixel_format", report.pixel_format},
                {"frame_rate_hz", highest_hz},
                {"steps", steps},
                {"session", report.session.string()}},
               text);
}

}  // namespace

void add_capture(CLI::App& app, Common& common) {
  struct Options {
    bool list = false;
    std::string plan, folder;
  };
  auto options = std::make_shared<Options>();
  CLI::App* command =
      add_command(app, common, "capture", "Take calibration frames with a GenICam camera", {},
                  [options, &common] {
                    if (options->list) return print_cameras(common);
                    if (options->plan.empty() || options->folder.empty())
                      throw CLI::ValidationError("capture", "needs a PLAN and -o DIR, or --list");
                    take(common, options->plan, options->folder);
                  });
  command->add_flag("--list", options->list, "show cameras and their pixel formats");
  command->add_option("PLAN", options->plan,
                      "what to take: gains, exposures, numbers of frames (TOML)");
  command->add_option("-o,--output", options->folder, "folder of the frames and of session.toml");
}

}  // namespace malus::app
