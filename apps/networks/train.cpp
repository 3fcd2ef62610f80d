#include "train.h"

#include "malus/base/error.h"
#include "malus/base/worker_place.h"
#include "malus/neural/gpu.h"
#include "malus/neural/named_source.h"
#include "malus/neural/noise_flow_training.h"
#include "malus/neural/trainer.h"

namespace malus::app {

namespace {

TrainingOverrides overrides_of(const TrainCall& call) {
  return {.pairs = call.pairs, .models = call.models, .settings = call.settings};
}

TrainOptions options_of(const TrainCall& call) {
  return {.folder = call.folder, .resume = call.resume, .force = call.force, .seed = call.seed};
}

TrainingConfig config_of(const TrainCall& call) {
  return load_training_config(call.config, overrides_of(call));
}

}  // namespace

void check_training(const TrainCall& call) {
  if (!is_noise_flow_config(call.config, call.settings))
    full_settings(config_of(call).package.network);
}

nlohmann::ordered_json train_network(const TrainCall& call, Progress& progress) {
  if (is_noise_flow_config(call.config, call.settings)) {
    if (worker_place_of_environment().size > 1)
      throw InputError(call.config.string(),
                       "a noise-flow is trained by one process, not by several",
                       "start it without torchrun, mpirun or srun");
    return train_noise_flow(load_noise_flow_config(call.config, overrides_of(call)),
                            options_of(call), progress);
  }
  const TrainingConfig config = config_of(call);
  const auto device =
      naming_source(config.source.string(), [&] { return training_device(config.train); });
  const auto workers = workers_of_environment(config.train.timeout_s, device, progress);
  return train(config, options_of(call), *workers, progress);
}

}  // namespace malus::app
