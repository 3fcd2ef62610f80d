// malus experiment: the papers' tables, small or full scale.
#include "experiments.h"
#include "program.h"

namespace malus::app {

std::string trained_weights(const std::string& name, TrainCall call, const Common& common,
                            Progress& progress) {
  note(common, "training " + name);
  call.resume = true;
  call.force = common.force;
  call.seed = common.seed;
  return networks().train(call, progress).at("weights").get<std::string>();
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
}

}  // namespace malus::app
