// malus experiment: the papers' tables, small or full scale.
#include "malus/base/error.h"
#include "malus/base/worker_place.h"

#include "experiments.h"
#include "flags.h"
#include "program.h"
#include <fmt/format.h>

namespace malus::app {

namespace {

// Read at last: what else is wrong with the row is said first.
bool is_trained_on_pairs(const ConfigSection& section, const TableRow& row) {
  if (!section.has("trained_on")) return false;
  if (const std::string data = section.text("trained_on").value_or(""); data != "pairs")
    section.fail("trained_on", fmt::format("= \"{}\" is not known", data),
                 "write trained_on = \"pairs\", or leave it out: the configuration names its data");
  if (row.config.empty())
    section.fail("trained_on", "is for trainings, and the row is a method", "leave it out");
  return true;
}

}  // namespace

std::vector<TableRow> table_rows(const ConfigSection& root, const std::filesystem::path& path,
                                 const std::vector<std::string>& more_keys) {
  std::vector<TableRow> rows;
  std::vector<std::string> known{"name", "method", "config"};
  known.insert(known.end(), more_keys.begin(), more_keys.end());
  for (const ConfigSection& section : root.sections("rows")) {
    section.require_known(known);
    TableRow row{section.text("name").value_or(""), section.text("method").value_or(""),
                 section.text("config").value_or("")};
    if (row.name.empty()) section.fail("name", "is missing", "say what the row shows");
    if (row.method.empty() == row.config.empty())
      section.fail("config", "or method is missing, or both are there", "give one of them");
    row.trained_on_pairs = is_trained_on_pairs(section, row);
    if (!row.config.empty()) row.config = path.parent_path() / row.config;
    if (const auto flow = section.text("noise_flow")) {
      if (row.config.empty())
        section.fail("noise_flow", "draws the noise of a training, and the row has none",
                     "give config, too");
      row.noise_flow = path.parent_path() / *flow;
    }
    rows.push_back(std::move(row));
  }
  if (rows.empty()) root.fail("rows", "are missing", "add [[rows]]");
  return rows;
}

void check_training(TrainCall call, const Common& common) {
  if (worker_place_of_environment().size > 1)
    throw InputError(call.config.string(),
                     "of an experiment is trained by one process, not by several",
                     "start it without torchrun, mpirun or srun");
  call.settings = common.settings;
  networks().check_training(call);
}

std::string trained_weights(const std::string& name, TrainCall call, const Common& common,
                            Progress& progress) {
  note(common, "training " + name);
  call.resume = true;
  call.force = common.force;
  call.seed = common.seed;
  call.settings = common.settings;
  return networks().train(call, progress).at("weights").get<std::string>();
}

void add_crop(CLI::App& command, int& crop, const std::string& of) {
  command.add_option("--crop", crop, "middle part of " + of + " [pixels]")
      ->check(in_range(16, 100000))
      ->capture_default_str();
}

void add_experiment(CLI::App& app, Common& common) {
  CLI::App* experiment =
      app.add_subcommand("experiment", "The papers' tables, small or full scale");
  experiment->require_subcommand(1);
  add_denoise_experiment(*experiment, common);
  add_uncertainty_experiment(*experiment, common);
  add_table_experiments(*experiment, common);
  add_renoise_experiment(*experiment, common);
  add_table_s1_experiment(*experiment, common);
  add_demosaic_experiment(*experiment, common);
  add_noise_experiment(*experiment, common);
}

}  // namespace malus::app
