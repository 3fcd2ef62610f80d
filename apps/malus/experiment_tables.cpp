// malus experiment table1, table2: networks trained by the rows of a file, each scored on the same
// noisy scenes: 000 Table 1 (networks and classical methods) and Table 2 (what each ingredient
// earns).
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/config_section.h"

#include <memory>

#include "experiments.h"
#include "networks_door.h"
#include "report_pages.h"
#include "scene_scores.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct TableArguments {
  fs::path rows, folder, report;
  std::vector<fs::path> scenes;
  std::string model = "imx250myr-simulated";
  std::vector<std::string> cases{"12:10", "12:60"};
  int crop = 512;
};

// A row is a training configuration, or a classical method.
struct TableRow {
  std::string name, method;
  fs::path config;
};

std::vector<TableRow> read_rows(const fs::path& path) {
  const ConfigSection root = ConfigSection::load(path, "the experiment");
  root.require_known({"rows"});
  std::vector<TableRow> rows;
  for (const ConfigSection& section : root.sections("rows")) {
    section.require_known({"name", "method", "config"});
    TableRow row{section.text("name").value_or(""), section.text("method").value_or(""),
                 section.text("config").value_or("")};
    if (row.name.empty()) section.fail("name", "is missing", "say what the row shows");
    if (row.method.empty() == row.config.empty())
      section.fail("config", "or method is missing, or both are there", "give one of them");
    if (!row.config.empty()) row.config = path.parent_path() / row.config;
    rows.push_back(std::move(row));
  }
  if (rows.empty()) root.fail("rows", "are missing", "add [[rows]]");
  return rows;
}

// A finished row is not trained again, an interrupted one goes on where it was.
std::string trained_weights(const TableRow& row, const TableArguments& arguments,
                            const Common& common, Progress& progress) {
  const fs::path folder = arguments.folder / row.config.stem();
  note(common, "training " + row.name);
  const Json run = networks().train({.config = row.config,
                                     .folder = folder,
                                     .resume = true,
                                     .force = common.force,
                                     .seed = common.seed},
                                    progress);
  return run.at("weights").get<std::string>();
}

void run(const TableArguments& arguments, const Common& common, const std::string& title) {
  if (!arguments.report.empty()) check_output(arguments.report, common.force);
  networks();
  const std::vector<TableRow> rows = read_rows(arguments.rows);
  const NoiseModel model = load_model(arguments.model);
  make_output_folder(arguments.folder);
  std::vector<CleanScene> scenes;
  for (const fs::path& folder : arguments.scenes)
    scenes.push_back(load_scene(folder, model, arguments.crop));
  const auto progress = make_progress(common);
  std::vector<SceneScore> scores;
  const auto score = [&](const std::string& name, const FrameDenoiser* denoiser) {
    scores.push_back({.name = name});
    std::uint64_t seed = common.seed;
    for (const CleanScene& scene : scenes)
      for (const std::string& text : arguments.cases) {
        check_stop(*progress);
        add_to_score(scores.back(), make_noisy(scene, light_case_of(text), model, seed++),
                     denoiser);
      }
  };
  score("noisy", nullptr);
  for (const TableRow& row : rows) {
    const std::string method =
        row.method.empty() ? trained_weights(row, arguments, common, *progress) : row.method;
    const FrameDenoiser denoiser(method_settings_of(method), InferenceSettings{}, false);
    score(row.name, &denoiser);
  }
  const Json json{{"model", arguments.model},
                  {"cases", arguments.cases},
                  {"crop", arguments.crop},
                  {"rows", score_json(scores)}};
  if (!arguments.report.empty())
    write_record_report(score_record(title, arguments.cases, arguments.model, scores),
                        arguments.report, common.force);
  print_result(common, json, score_text(scores));
}

void add_table(CLI::App& experiment, Common& common, const std::string& name,
               const std::string& title) {
  const auto arguments = std::make_shared<TableArguments>();
  CLI::App* command = add_command(experiment, common, name, title,
                                  [arguments, &common, title] { run(*arguments, common, title); });
  command
      ->add_option("ROWS", arguments->rows, "the table's rows, e.g. experiments/" + name + ".toml")
      ->required();
  command
      ->add_option("--scenes", arguments->scenes,
                   "folders with I0.png, I45.png, I90.png, I135.png to score on; not those "
                   "that are trained on")
      ->required();
  command->add_option("-o,--output", arguments->folder, "folder of the trainings")->required();
  command->add_option("--model", arguments->model, "noise model, a file or a built-in name")
      ->capture_default_str();
  command->add_option("--cases", arguments->cases, "gain [dB] : low-light ratio")
      ->capture_default_str();
  command->add_option("--report", arguments->report, "also a report page (HTML)");
  command->add_option("--crop", arguments->crop, "middle part of the scenes [pixels]")
      ->check(CLI::Range(16, 100000))
      ->capture_default_str();
}

}  // namespace

void add_table_experiments(CLI::App& experiment, Common& common) {
  add_table(experiment, common, "table1", "000 Table 1: methods and networks");
  add_table(experiment, common, "table2", "000 Table 2: what each ingredient of training earns");
}

}  // namespace malus::app
