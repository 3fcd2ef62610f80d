// What a training run tells of itself when it has ended: for JSON and the report.
#pragma once

#include "malus/neural/training_config.h"

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus {

struct RunFacts {
  std::filesystem::path folder;
  std::int64_t parameters = 0, steps = 0;
  int workers = 1;
  std::string device;
  double seconds = 0;
  double best_score_db = 0;            ///< of validations; meant only where there are any
  nlohmann::ordered_json shares = {};  ///< PairSource::shares
};

/// Whether a line of log.jsonl holds this of the step: "noisy", "validation".
bool is_told(const std::vector<nlohmann::ordered_json>& log, const char* key, std::int64_t step);

/// log: the lines of log.jsonl, which hold the losses, and the scores of noisy frames, guide and
/// validations.
nlohmann::ordered_json run_record(const TrainingConfig& config, const RunFacts& facts,
                                  const std::vector<nlohmann::ordered_json>& log);

/// Whether the folder holds everything that the run would still make after its last step.
bool is_finished(const TrainingConfig& config, const RunFacts& facts,
                 const std::vector<nlohmann::ordered_json>& log);

/// The record of such a run, "finished_before" in it.
nlohmann::ordered_json finished_record(const TrainingConfig& config, const RunFacts& facts,
                                       const std::vector<nlohmann::ordered_json>& log);

/// What a weight file tells of the training that made it: the numbers of its data, its settings
/// (description: config_json with the seed) and the log's last scores. No times: equal trainings
/// give equal files.
nlohmann::json training_told(const TrainingConfig& config, const RunFacts& facts,
                             const nlohmann::json& description,
                             const std::vector<nlohmann::ordered_json>& log);

}  // namespace malus
