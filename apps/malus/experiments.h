// The experiments of `malus experiment`, one file each.
#pragma once

#include "program.h"

namespace malus::app {

void add_denoise_experiment(CLI::App& experiment, Common& common);
void add_uncertainty_experiment(CLI::App& experiment, Common& common);
void add_renoise_experiment(CLI::App& experiment, Common& common);
void add_table_experiments(CLI::App& experiment, Common& common);
void add_table_s1_experiment(CLI::App& experiment, Common& common);
void add_demosaic_experiment(CLI::App& experiment, Common& common);

}  // namespace malus::app
