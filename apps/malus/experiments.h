// The experiments of `malus experiment`, one file each.
#pragma once

#include "malus/io/config_section.h"

#include <filesystem>
#include <string>
#include <vector>

#include "networks_door.h"
#include "program.h"

namespace malus::app {

/// A row of a table is a training configuration, or a classical method.
struct TableRow {
  std::string name, method;
  std::filesystem::path config;
  bool trained_on_pairs = false;  ///< on captured pairs, in place of the configuration's data
  /// Configuration of a Noise Flow, which is trained first and draws the noise of the training;
  /// else empty.
  std::filesystem::path noise_flow = {};
};
/// [[rows]] of an experiment's file: configurations lie beside it. more_keys: what this
/// experiment's rows may have besides: trained_on (= "pairs"), noise_flow. Throws InputError.
std::vector<TableRow> table_rows(const ConfigSection& root, const std::filesystem::path& path,
                                 const std::vector<std::string>& more_keys = {});

/// Throws InputError where a row's training (as below) could not begin. Asked of all rows before
/// the first is trained.
void check_training(TrainCall call, const Common& common);

/// The weights of a row's training (its configuration and folder in call, the rest is set here). A
/// finished one is not trained again, an interrupted one goes on where it was. Throws InputError,
/// Cancelled.
std::string trained_weights(const std::string& name, TrainCall call, const Common& common,
                            Progress& progress);

/// --crop: the middle part of what is named, in pixels a side.
void add_crop(CLI::App& command, int& crop, const std::string& of);

void add_denoise_experiment(CLI::App& experiment, Common& common);
void add_uncertainty_experiment(CLI::App& experiment, Common& common);
void add_renoise_experiment(CLI::App& experiment, Common& common);
void add_table_experiments(CLI::App& experiment, Common& common);
void add_table_s1_experiment(CLI::App& experiment, Common& common);
void add_demosaic_experiment(CLI::App& experiment, Common& common);
void add_noise_experiment(CLI::App& experiment, Common& common);

}  // namespace malus::app
