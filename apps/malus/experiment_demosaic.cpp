// malus experiment denoise-demosaic: 001, sections 5.1 and S4. A network that denoises and
// demosaicks at once is trained on each kind of noise model and scored on captures; with
// target = "srgb" in the rows' configurations it is a neural ISP.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/config_section.h"
#include "malus/polar/demosaick.h"
#include "malus/synthesize/equivalent_models.h"
#include "malus/synthesize/model.h"

#include <algorithm>
#include <memory>
#include <optional>

#include "captures.h"
#include "denoiser_by_ratio.h"
#include "experiments.h"
#include "flow_rows.h"
#include "frame_input.h"
#include "networks_door.h"
#include "output_check.h"
#include "report_pages.h"
#include "scene_scores.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct DemosaicExperimentArguments {
  fs::path rows, folder, report, pairs, flow_pairs;
  std::vector<fs::path> pictures;
  int crop = 512;
};

struct DemosaicSetup {
  std::string model = "nikon-d850", camera;
  std::vector<double> gains;
  std::vector<std::string> cases;
  double exposure = 1;
  std::vector<TableRow> rows;
};

DemosaicSetup read_demosaic_setup(const fs::path& path) {
  const ConfigSection root = ConfigSection::load(path, "the experiment");
  root.require_known({"model", "camera", "gains", "cases", "exposure", "rows"});
  DemosaicSetup setup;
  setup.model = root.text("model").value_or(setup.model);
  setup.camera = root.text("camera").value_or(setup.model);
  setup.exposure = root.positive_number("exposure").value_or(setup.exposure);
  setup.gains = root.numbers("gains");
  setup.cases = root.texts("cases");
  if (setup.gains.empty()) root.fail("gains", "are missing", "name those to train at");
  setup.rows = table_rows(root, path, {"noise_flow"});
  return setup;
}

std::vector<GainSetting> gains_of(const Model& door, const DemosaicSetup& setup) {
  std::vector<GainSetting> gains;
  for (const double gain : setup.gains) gains.push_back(door.gain_setting(gain));
  return gains;
}

// The model with all kinds that rows may be trained on, as a file for their trainings.
void save_complete_model(const Model& door, const DemosaicSetup& setup, const fs::path& path) {
  const std::vector<GainSetting> gains = gains_of(door, setup);
  warn_of_untold_gain(door.description(), setup.model, gains);
  save_model(with_equivalents(door.description(), gains), path, true);
}

FlowCaptures flow_captures(const DemosaicExperimentArguments& arguments, const DemosaicSetup& setup,
                           const Model& door) {
  return {.pairs = arguments.flow_pairs,
          .model = arguments.folder / "model.h5",
          .gains = gains_of(door, setup),
          .exposure = setup.exposure,
          .crop = arguments.crop};
}

// What no row could be trained with is refused before the first is.
void check_rows(const DemosaicExperimentArguments& arguments, const DemosaicSetup& setup,
                const Model& door, const Common& common) {
  bool flows = false;
  for (const TableRow& row : setup.rows) {
    if (row.method.empty())
      check_training({.config = row.config, .models = {arguments.folder / "model.h5"}}, common);
    if (row.noise_flow.empty()) continue;
    flows = true;
    // A simulated camera's noise would teach the flow the model that it is compared with.
    if (!arguments.pairs.empty() && arguments.flow_pairs.empty())
      throw InputError(arguments.rows.string(),
                       fmt::format("the flow of its row \"{}\" learns from captures, and --pairs "
                                   "are to score on",
                                   row.name),
                       "give others with --flow-pairs, or leave the row out");
    check_flow(row, flow_captures(arguments, setup, door), common);
  }
  if (!arguments.flow_pairs.empty() && !flows)
    throw InputError("--flow-pairs", "no row has a Noise Flow", "leave it out");
}

std::vector<RecordedPair> test_captures(const DemosaicExperimentArguments& arguments,
                                        const DemosaicSetup& setup, const Model& door,
                                        std::uint64_t seed, Progress& progress) {
  if (!arguments.pairs.empty()) return open_pairs({arguments.pairs}, &door.description());
  const NoiseModel camera = load_model(setup.camera);
  std::vector<RecordedPair> captures;
  for (std::size_t i = 0; i < setup.cases.size(); ++i) {
    const LightCase light = light_case_of(setup.cases[i]);
    const CameraShot shot{.gain = door.gain_setting(light.gain),
                          .ratio = light.ratio,
                          .exposure = setup.exposure,
                          .crop = arguments.crop};
    for (RecordedPair& capture : take_pictures(
             camera, arguments.pictures, shot,
             arguments.folder / "captures" / fmt::format("case{}", i), seed + i, progress))
      captures.push_back(std::move(capture));
  }
  return captures;
}

// One row: over all captures, and over those of each gain.
Json score_on_captures(const std::string& name, const std::vector<RecordedPair>& captures,
                       const NoiseModel& model, const std::optional<std::string>& method,
                       Progress& progress) {
  std::optional<DenoiserByRatio> denoisers;
  if (method) denoisers.emplace(method_settings_of(*method));
  PictureScore all;
  std::vector<std::pair<std::string, PictureScore>> by_gain;
  for (const RecordedPair& capture : captures) {
    check_stop(progress);
    const std::string gain = capture.gain.text();
    auto of_gain = std::find_if(by_gain.begin(), by_gain.end(),
                                [&](const auto& known) { return known.first == gain; });
    if (of_gain == by_gain.end()) of_gain = by_gain.insert(of_gain, {gain, {}});
    PictureScore one;
    add_to_score(one, capture, model, denoisers ? &denoisers->at(capture.ratio) : nullptr);
    for (PictureScore* sum : {&all, &of_gain->second}) {
      sum->psnr_db += one.psnr_db;
      sum->ssim += one.ssim;
      sum->seconds += one.seconds;
      ++sum->count;
    }
  }
  const auto means = [](const PictureScore& score) {
    return Json{{"psnr_db", score.psnr_db / score.count},
                {"ssim", score.ssim / score.count},
                {"seconds", score.seconds / score.count}};
  };
  Json row{{"name", name}};
  row.update(means(all));
  row["gains"] = Json::array();
  for (const auto& [gain, score] : by_gain) {
    row["gains"].push_back({{"gain", gain}});
    row["gains"].back().update(means(score));
  }
  return row;
}

std::string demosaic_text(const Json& rows) {
  std::string table =
      "| noise model | PSNR [dB] | SSIM | s per frame |\n"
      "|---|---|---|---|\n";
  for (const Json& row : rows)
    table += fmt::format("| {} | {:.2f} | {:.3f} | {:.2f} |\n", row["name"].get<std::string>(),
                         row["psnr_db"].get<double>(), row["ssim"].get<double>(),
                         row["seconds"].get<double>());
  return table;
}

Json demosaic_record(const Json& rows) {
  Json table = record_table(
      "Means over captures", "Trained on each noise model, scored on the same captures.",
      "noise model", {{"PSNR", "dB"}, {"SSIM", "1"}, {"time per frame", "s"}});
  for (const Json& row : rows)
    add_record_row(table, row["name"].get<std::string>(),
                   {row["psnr_db"], row["ssim"], row["seconds"]});
  return {{"title", "Joint denoising and demosaicking"}, {"tables", Json::array({table})}};
}

// A row's method: a classical one, or the weights of its training.
std::string method_of(const TableRow& row, const DemosaicExperimentArguments& arguments,
                      const DemosaicSetup& setup, const Model& door, const Common& common,
                      Progress& progress) {
  if (!row.method.empty()) return row.method;
  fs::path model = arguments.folder / "model.h5";
  if (!row.noise_flow.empty())
    model = trained_flow(row, flow_captures(arguments, setup, door), load_model(setup.camera),
                         arguments.folder, common, progress);
  return trained_weights(
      row.name,
      {.config = row.config, .folder = arguments.folder / row.config.stem(), .models = {model}},
      common, progress);
}

void run_demosaic_experiment(const DemosaicExperimentArguments& arguments, const Common& common) {
  if (arguments.pictures.empty() && arguments.pairs.empty())
    throw CLI::RequiredError("one of --pictures and --pairs");
  std::vector<fs::path> read = arguments.pictures;
  read.insert(read.end(), {arguments.rows, arguments.pairs, arguments.flow_pairs});
  check_report_apart(arguments.report, read, {}, common.force);
  networks();
  const DemosaicSetup setup = read_demosaic_setup(arguments.rows);
  const Model door = Model::load(setup.model);
  if (!is_bayer(door.description().layout))
    throw InputError(setup.model, "is not of a Bayer sensor",
                     "set another model in the rows' file");
  check_rows(arguments, setup, door, common);
  const OutputFolder output(arguments.folder);
  const auto progress = make_progress(common);
  const std::vector<RecordedPair> captures =
      test_captures(arguments, setup, door, common.seed, *progress);
  if (captures.empty())
    throw InputError(arguments.rows.string(), "names no cases", "e.g. cases = [\"1600:1\"]");
  save_complete_model(door, setup, arguments.folder / "model.h5");
  Json rows = Json::array();
  rows.push_back(
      score_on_captures("none: noisy, demosaicked", captures, door.description(), {}, *progress));
  for (const TableRow& row : setup.rows)
    rows.push_back(score_on_captures(row.name, captures, door.description(),
                                     method_of(row, arguments, setup, door, common, *progress),
                                     *progress));
  if (!arguments.report.empty())
    write_record_report(demosaic_record(rows), arguments.report, common.force);
  print_result(common,
               {{"model", setup.model},
                {"camera", setup.camera},
                {"captures", captures.size()},
                {"rows", rows}},
               demosaic_text(rows));
}

}  // namespace

void add_demosaic_experiment(CLI::App& experiment, Common& common) {
  const auto arguments = std::make_shared<DemosaicExperimentArguments>();
  CLI::App* command =
      add_command(experiment, common, "denoise-demosaic",
                  "Joint denoising and demosaicking, trained on every kind of noise model",
                  {.seed = true, .force = true},
                  [arguments, &common] { run_demosaic_experiment(*arguments, common); });
  command
      ->add_option("ROWS", arguments->rows,
                   "the table's rows, e.g. experiments/denoise-demosaic.toml")
      ->required();
  CLI::Option* pictures = command->add_option(
      "--pictures", arguments->pictures,
      "pictures that a simulated camera takes to score on; not those that are trained on");
  command
      ->add_option("--pairs", arguments->pairs,
                   "in their place: captured pairs (pairs.json of malus pairs)")
      ->excludes(pictures);
  command->add_option("--flow-pairs", arguments->flow_pairs,
                      "captured pairs that rows of Noise Flow learn the noise from; otherwise the "
                      "simulated camera takes the pictures that the networks are trained on");
  command->add_option("-o,--output", arguments->folder, "folder of the trainings")->required();
  add_training_settings(*command, common);
  add_crop(*command, arguments->crop, "the pictures");
  command->add_option("--report", arguments->report, "also a report page (HTML)");
}

}  // namespace malus::app
