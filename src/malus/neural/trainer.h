// Training: batches from the example pool -> loss -> gradients, summed over the workers -> Adam ->
// moving average of the weights; now and then a line in the log, a validation, a checkpoint.
//
// Files in the run's folder, all written by worker 0: checkpoint.safetensors (to go on),
// log.jsonl (one JSON object per line), best.safetensors (package with the best validation so far),
// weights.safetensors (package at the end), sample/ (the first validation frame as mosaics).
#pragma once

#include "malus/base/progress.h"
#include "malus/neural/training_config.h"
#include "malus/neural/workers.h"

#include <cstdint>
#include <filesystem>

namespace malus {

struct TrainOptions {
  std::filesystem::path folder;
  bool resume = false;  ///< go on where the folder's checkpoint is; from the start without one
  bool force = false;   ///< an existing run in the folder may be replaced (run_folder.h)
  std::uint64_t seed = 0;
};

/// Result: the record for JSON and report: steps, workers, seconds, the log (its lines hold the
/// losses, the validations and the share of the time that steps waited for examples), best score,
/// name of the weights. The weights are the same
/// bits for any number of interruptions, and within rounding for any number of workers.
/// Throws InputError, also when the loss is no number any more or has exploded; Cancelled after a
/// checkpoint when a stop was requested.
nlohmann::ordered_json train(const TrainingConfig& config, const TrainOptions& options,
                             Workers& workers, Progress& progress);

}  // namespace malus
