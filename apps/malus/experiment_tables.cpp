// malus experiment table1, table2: networks trained by the rows of a file, each scored on the same
// noisy scenes or captured frames: 000 Table 1 (networks and classical methods) and Table 2 (what
// each ingredient earns).
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/io/config_section.h"

#include <memory>
#include <utility>

#include "captures.h"
#include "experiments.h"
#include "networks_door.h"
#include "output_check.h"
#include "report_pages.h"
#include "scene_scores.h"
#include "test_frames.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct TableArguments {
  TestFrames frames;
  fs::path rows, folder, report;
  std::vector<fs::path> pairs;  // to train on

  // Of captures, to train or to score on, the noise is that of their camera's model everywhere.
  bool captured() const { return frames.captured() || !pairs.empty(); }
};

// The rows that can be shown, and the names of those that are left out for want of pairs.
struct TableFile {
  std::vector<TableRow> rows;
  std::vector<std::string> left_out;
};

TableFile read_table(const TableArguments& arguments) {
  const ConfigSection root = ConfigSection::load(arguments.rows, "the experiment");
  root.require_known({"rows"});
  TableFile table;
  bool any_on_pairs = false;
  for (TableRow& row : table_rows(root, arguments.rows, {"trained_on"})) {
    any_on_pairs = any_on_pairs || row.trained_on_pairs;
    if (row.trained_on_pairs && arguments.pairs.empty())
      table.left_out.push_back(row.name);
    else
      table.rows.push_back(std::move(row));
  }
  if (!arguments.pairs.empty() && !any_on_pairs)
    throw InputError(arguments.rows.string(), "has no row with trained_on = \"pairs\"",
                     "mark the rows that are to be trained on --pairs, or leave it out");
  return table;
}

TrainCall training_of(const TableRow& row, const TableArguments& arguments) {
  const std::string folder = row.config.stem().string() + (row.trained_on_pairs ? "-pairs" : "");
  TrainCall call{.config = row.config, .folder = arguments.folder / folder};
  if (row.trained_on_pairs) call.pairs = arguments.pairs;
  if (arguments.captured()) call.models = {arguments.frames.scenes.model};
  return call;
}

// Before hours of training: what no row could be trained on.
void check_pairs_apart(const TableArguments& arguments, const OpenTestFrames& frames) {
  if (arguments.pairs.empty()) return;
  const std::vector<RecordedPair> pairs = open_pairs(arguments.pairs, frames.model());
  if (const auto shared = frames.shared_with(pairs); !shared.empty())
    warn(
        fmt::format("{} of --test-pairs {} among --pairs, too: such a score says nothing of other "
                    "scenes",
                    joined(shared), shared.size() == 1 ? "is" : "are"));
}

void run_table(const TableArguments& arguments, const Common& common, const std::string& title) {
  arguments.frames.check_usage();
  if (arguments.captured() && !arguments.frames.model_given())
    throw CLI::ValidationError("--pairs", "give the noise model of their camera with --model");
  std::vector<fs::path> read = arguments.frames.files_named();
  read.insert(read.end(), arguments.pairs.begin(), arguments.pairs.end());
  read.push_back(arguments.rows);
  check_report_apart(arguments.report, read, {}, common.force);
  networks();
  const TableFile table = read_table(arguments);
  for (const TableRow& row : table.rows)
    if (row.method.empty()) check_training(training_of(row, arguments), common);
  OpenTestFrames frames(arguments.frames);
  check_pairs_apart(arguments, frames);
  if (!table.left_out.empty())
    note(common, fmt::format("left out without --pairs, which they are trained on: {}",
                             joined(table.left_out)));
  const OutputFolder output(arguments.folder);
  const auto progress = make_progress(common);
  std::vector<SceneScore> scores;
  const auto score = [&](const std::string& name, DenoiserByRatio* denoiser) {
    SceneScore& row = scores.emplace_back(SceneScore{.name = name});
    frames.for_each(common.seed, *progress, [&](const NoisyScene& noisy, const ScoredLight& light) {
      add_to_score(row, noisy, light, denoiser);
    });
  };
  score("noisy", nullptr);
  for (const TableRow& row : table.rows) {
    const std::string method =
        row.method.empty()
            ? trained_weights(row.name, training_of(row, arguments), common, *progress)
            : row.method;
    DenoiserByRatio denoiser(method_settings_of(method));
    score(row.name, &denoiser);
  }
  Json json = frames.facts();
  if (!table.left_out.empty()) json["left_out"] = table.left_out;
  json["rows"] = score_json(scores);
  if (!arguments.report.empty())
    write_record_report(frames.record(title, scores), arguments.report, common.force);
  print_result(common, json, score_text_by_case(scores));
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
  arguments->frames.scenes.cases = {"12:10", "12:60"};
  arguments->frames.add_options(*command, "--scenes", "; not those that are trained on");
  command->add_option("--pairs", arguments->pairs,
                      "captured pairs that rows with trained_on = \"pairs\" are trained on "
                      "(pairs.json of malus pairs); without, these rows are left out");
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
