// malus experiment table1, table2: networks trained by the rows of a file, each scored on the same
// noisy scenes: 000 Table 1 (networks and classical methods) and Table 2 (what each ingredient
// earns).
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/config_section.h"

#include <memory>

#include "experiments.h"
#include "networks_door.h"
#include "output_check.h"
#include "report_pages.h"
#include "scene_scores.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct TableArguments {
  SceneRuns runs{.scenes = {}, .cases = {"12:10", "12:60"}};
  fs::path rows, folder, report;
};

std::vector<TableRow> read_table(const fs::path& path) {
  const ConfigSection root = ConfigSection::load(path, "the experiment");
  root.require_known({"rows"});
  return table_rows(root, path);
}

void run_table(const TableArguments& arguments, const Common& common, const std::string& title) {
  std::vector<fs::path> read = arguments.runs.files_named();
  read.push_back(arguments.rows);
  check_report_apart(arguments.report, read, {}, common.force);
  networks();
  const std::vector<TableRow> rows = read_table(arguments.rows);
  for (const TableRow& row : rows)
    if (row.method.empty()) check_training({.config = row.config}, common);
  const NoiseModel model = arguments.runs.load_camera();
  const OutputFolder output(arguments.folder);
  const auto progress = make_progress(common);
  std::vector<SceneScore> scores;
  const auto score = [&](const std::string& name, DenoiserByRatio* denoiser) {
    SceneScore& row = scores.emplace_back(SceneScore{.name = name});
    arguments.runs.for_each(model, common.seed, *progress,
                            [&](const NoisyScene& noisy, const std::string& light) {
                              add_to_score(row, noisy, light, denoiser);
                            });
  };
  score("noisy", nullptr);
  for (const TableRow& row : rows) {
    const std::string method =
        row.method.empty()
            ? trained_weights(
                  row.name, {.config = row.config, .folder = arguments.folder / row.config.stem()},
                  common, *progress)
            : row.method;
    DenoiserByRatio denoiser(method_settings_of(method));
    score(row.name, &denoiser);
  }
  const Json json{{"model", arguments.runs.model},
                  {"cases", arguments.runs.cases},
                  {"crop", arguments.runs.crop},
                  {"rows", score_json(scores)}};
  if (!arguments.report.empty())
    write_record_report(score_record(title, arguments.runs, model, scores), arguments.report,
                        common.force);
  print_result(common, json, score_text_by_case(scores, model));
}

void add_table(CLI::App& experiment, Common& common, const std::string& name,
               const std::string& title) {
  const auto arguments = std::make_shared<TableArguments>();
  CLI::App* command =
      add_command(experiment, common, name, title, {.seed = true, .force = true},
                  [arguments, &common, title] { run_table(*arguments, common, title); });
  command
      ->add_option("ROWS", arguments->rows, "the table's rows, e.g. experiments/" + name + ".toml")
      ->required();
  arguments->runs.add_options(*command, "--scenes", "; not those that are trained on");
  command->add_option("-o,--output", arguments->folder, "folder of the trainings")->required();
  add_training_settings(*command, common);
  command->add_option("--report", arguments->report, "also a report page (HTML)");
}

}  // namespace

void add_table_experiments(CLI::App& experiment, Common& common) {
  add_table(experiment, common, "table1",
            "Table 1 of \"Polarized Color Image Denoising\": methods and networks");
  add_table(
      experiment, common, "table2",
      "Table 2 of \"Polarized Color Image Denoising\": what each ingredient of training earns");
}

}  // namespace malus::app
