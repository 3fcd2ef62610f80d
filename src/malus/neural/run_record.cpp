#include "malus/neural/internal/run_record.h"

#include "malus/base/error.h"
#include "malus/neural/internal/validation.h"

#include <algorithm>

namespace malus {
namespace {

using OrderedJson = nlohmann::ordered_json;
namespace fs = std::filesystem;

bool has_sample(const TrainingConfig& config) {
  return !config.validation_scenes.empty() && !config.package.gives_picture();
}

// Of an earlier run, or of none that can be read: there is work to do.
bool are_weights_of(const fs::path& weights, std::int64_t steps) {
  if (!fs::exists(weights)) return false;
  try {
    const NetworkPackage package = package_of(load_tensor_file(weights), weights.string());
    return package.training.is_object() &&
           package.training.value("steps", std::int64_t{-1}) == steps;
  } catch (const InputError&) {
    return false;
  }
}

}  // namespace

bool is_told(const std::vector<OrderedJson>& log, const char* key, std::int64_t step) {
  return std::any_of(log.begin(), log.end(), [&](const OrderedJson& line) {
    return line.contains(key) && line["step"] == step;
  });
}

OrderedJson run_record(const TrainingConfig& config, const RunFacts& facts,
                       const std::vector<OrderedJson>& log) {
  OrderedJson record{{"config", config.source.string()},
                     {"architecture", config.package.network.architecture},
                     {"parameters", facts.parameters},
                     {"steps", facts.steps},
                     {"workers", facts.workers},
                     {"device", facts.device},
                     {"seconds", facts.seconds},
                     {"weights", (facts.folder / "weights.safetensors").string()},
                     {"log", log}};
  if (!facts.shares.is_null()) record["shares"] = facts.shares;
  if (config.validation_scenes.empty()) return record;
  for (const OrderedJson& line : log)
    for (const char* score : {"noisy", "guide"})
      if (line.contains(score)) record[score] = line[score];
  record["best_score_db"] = facts.best_score_db;
  return record;
}

bool is_finished(const TrainingConfig& config, const RunFacts& facts,
                 const std::vector<OrderedJson>& log) {
  if (facts.steps != config.train.steps ||
      !are_weights_of(facts.folder / "weights.safetensors", facts.steps))
    return false;
  if (config.validation_scenes.empty()) return true;
  if (!is_told(log, "noisy", 0) || !is_told(log, "validation", facts.steps)) return false;
  return !has_sample(config) || sample_entry(config, facts.folder / "sample")["files"].size() > 2;
}

OrderedJson finished_record(const TrainingConfig& config, const RunFacts& facts,
                            const std::vector<OrderedJson>& log) {
  OrderedJson record = run_record(config, facts, log);
  record["finished_before"] = true;
  if (has_sample(config)) record["sample"] = sample_entry(config, facts.folder / "sample");
  return record;
}

nlohmann::json training_told(const TrainingConfig& config, const RunFacts& facts,
                             const nlohmann::json& description,
                             const std::vector<OrderedJson>& log) {
  nlohmann::json told{{"steps", facts.steps},
                      {"device", facts.device},
                      {"workers", facts.workers},
                      {"pictures", config.pictures.size()},
                      {"scenes", config.scenes.size()},
                      {"shards", config.shards.size()},
                      {"pairs", config.pairs.size()},
                      {"seed", description.at("seed")},
                      {"data", description.at("data")},
                      {"noise", description.at("noise")},
                      {"train", description.at("train")}};
  if (!facts.shares.is_null()) told["shares"] = facts.shares;
  if (description.contains("begin_with")) told["begin_with"] = description["begin_with"];
  for (const OrderedJson& line : log)
    for (const char* score : {"guide", "validation"})
      if (line.contains(score)) told[score] = line[score];
  return told;
}

}  // namespace malus
