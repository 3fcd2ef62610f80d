// The experiments of `malus experiment`, one file each.
#pragma once

#include <string>

#include "networks_door.h"
#include "program.h"

namespace malus::app {

/// The weights of a row's training (its configuration and folder in call, the rest is set here). A
/// finished one is not trained again, an interrupted one goes on where it was. Throws InputError,
/// Cancelled.
std::string trained_weights(const std::string& name, TrainCall call, const Common& common,
                            Progress& progress);

void add_denoise_experiment(CLI::App& experiment, Common& common);
void add_uncertainty_experiment(CLI::App& experiment, Common& common);
void add_renoise_experiment(CLI::App& experiment, Common& common);
void add_table_experiments(CLI::App& experiment, Common& common);
void add_table_s1_experiment(CLI::App& experiment, Common& common);
void add_demosaic_experiment(CLI::App& experiment, Common& common);

}  // namespace malus::app
