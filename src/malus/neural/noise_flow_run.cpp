// A Noise Flow's training and its folder.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/neural/internal/run_folder.h"
#include "malus/neural/internal/same_run.h"
#include "malus/neural/noise_flow_training.h"
#include "malus/neural/trainer.h"

#include <fmt/format.h>

namespace malus {
namespace {

using OrderedJson = nlohmann::ordered_json;
namespace fs = std::filesystem;

constexpr const char* kOfTraining = "of_training";  ///< description and seed, in a flow's record

// The record of the training that wrote these weights; null where there are none, or none that tell
// of it.
OrderedJson record_of_finished(const fs::path& weights, const nlohmann::json& description) {
  if (!fs::exists(weights)) return {};
  const nlohmann::json told = NoiseFlowModel(weights).training();
  if (!told.is_object() || !told.contains(kOfTraining))
    throw InputError(weights.string(), "does not tell which training it is of",
                     "train in another folder");
  if (const Difference other = first_difference(description, told[kOfTraining]);
      !other.what.empty())
    throw InputError(weights.string(),
                     fmt::format("belongs to a run with {}{}", other.what, other.values()),
                     "set it as it was, or train in another folder");
  OrderedJson record = told;
  record.erase(kOfTraining);
  record["seconds"] = 0.0;
  record["finished_before"] = true;
  return record;
}

}  // namespace

OrderedJson train_noise_flow(const NoiseFlowConfig& config, const TrainOptions& options,
                             Progress& progress) {
  nlohmann::json description = config_json(config);
  description["seed"] = options.seed;
  const fs::path weights = options.folder / "weights.safetensors";
  const OutputFolder made(options.folder);
  const FolderLock lock(options.folder, "training");
  OrderedJson record;
  if (options.resume) record = record_of_finished(weights, description);
  if (record.is_null()) {
    check_output(weights, options.force);
    NoiseFlowFit fit = train_noise_flow(config, options.seed, progress);
    record = std::move(fit.record);
    // Without times: equal trainings give equal files.
    nlohmann::json told = record;
    told.erase("seconds");
    told[kOfTraining] = description;
    fit.model.save(weights, told);
  }
  record["weights"] = weights.string();
  return record;
}

}  // namespace malus
