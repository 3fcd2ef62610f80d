// malus calibrate: a session of bias and flat frames (or bursts) becomes a noise model.
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/warnings_of_gains.h"
#include "malus/io/session.h"
#include "malus/noise/model.h"

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "flags.h"
#include "freed_memory.h"
#include "model_json.h"
#include "output_check.h"
#include "program.h"
#include "report_pages.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

struct CalibrateArguments {
  std::filesystem::path session, output, report;
  std::vector<std::string> kinds = {std::string(model_kind_name(ModelKind::kPhysics))};
  CalibrationSettings settings;
};

void calibrate_session(const Common& common, const CalibrateArguments& arguments) {
  return_freed_planes();
  const Session session = load_session(arguments.session);
  const std::vector<std::filesystem::path> read = files_read(session);
  check_output_apart("-o", arguments.output, read, {}, common.force);
  check_output_apart("--report", arguments.report, read, {arguments.output}, common.force);
  const auto progress = make_progress(common);
  const NoiseModel model = calibrate(calibration_input(session), arguments.settings,
                                     model_kinds(arguments.kinds), *progress);
  save_model(model, arguments.output, common.force);
  if (!arguments.report.empty()) write_calibration_report(model, arguments.report, common.force);
  for (const std::string& line : warnings_of_gains(model)) warn(line);
  nlohmann::ordered_json json = model_json(model);
  json["model"] = arguments.output.string();
  json["settings"] = settings_json(arguments.settings);
  print_result(common, json,
               fmt::format("{}\n{}", arguments.output.string(),
                           model_text(model, StoredWarnings::kLeftOut)));
}

}  // namespace

void add_calibrate(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<CalibrateArguments>();
  CLI::App* command =
      add_command(app, common, "calibrate", "Measure a camera's noise from bias and flat frames",
                  {.force = true}, [&common, arguments] { calibrate_session(common, *arguments); });
  command
      ->add_option("SESSION", arguments->session,
                   "session file that names the frames (docs/session.md)")
      ->required();
  command->add_option("-o,--output", arguments->output, "noise model to write (HDF5)")->required();
  command->add_option("--kind", arguments->kinds, "kinds of model, separated by commas")
      ->delimiter(',')
      ->check(one_of(model_kind_names()))
      ->capture_default_str();
  command->add_option("--report", arguments->report, "also a report page (HTML)");
  add_flags(*command, arguments->settings);
}

}  // namespace malus::app
