#include "train.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/worker_place.h"
#include "malus/neural/gpu.h"
#include "malus/neural/named_source.h"
#include "malus/neural/noise_flow_training.h"
#include "malus/neural/trainer.h"

namespace malus::app {

namespace {

// Noise Flows train in minutes: one process, from the start.
nlohmann::ordered_json train_flow(const TrainCall& call, Progress& progress) {
  if (call.resume)
    throw InputError("--resume", "has nothing to go on from: a noise-flow keeps no checkpoint",
                     "train it again, with --force where its folder holds weights");
  if (worker_place_of_environment().size > 1)
    throw InputError(call.config.string(), "a noise-flow is trained by one process, not by several",
                     "start it without torchrun, mpirun or srun");
  const auto weights = call.folder / "weights.safetensors";
  // The folder is made for good results only, but that it can be is asked before hours of work.
  const std::filesystem::path folder = std::filesystem::absolute(call.folder);
  std::filesystem::path there = folder;
  while (!std::filesystem::exists(there)) there = there.parent_path();
  check_output(there / weights.filename(), call.force || there != folder);
  NoiseFlowFit fit = train_noise_flow_config(call.config, call.settings, call.seed, progress);
  make_output_folder(call.folder);
  fit.model.save(weights, fit.record);
  fit.record["weights"] = weights.string();
  return fit.record;
}

TrainingConfig config_of(const TrainCall& call) {
  return load_training_config(
      call.config, {.pairs = call.pairs, .models = call.models, .settings = call.settings});
}

}  // namespace

void check_training(const TrainCall& call) {
  if (!is_noise_flow_config(call.config, call.settings))
    full_settings(config_of(call).package.network);
}

nlohmann::ordered_json train_network(const TrainCall& call, Progress& progress) {
  if (is_noise_flow_config(call.config, call.settings)) return train_flow(call, progress);
  const TrainingConfig config = config_of(call);
  const auto device =
      naming_source(config.source.string(), [&] { return training_device(config.train); });
  const auto workers = workers_of_environment(config.train.timeout_s, device, progress);
  return train(
      config,
      {.folder = call.folder, .resume = call.resume, .force = call.force, .seed = call.seed},
      *workers, progress);
}

}  // namespace malus::app
