#include "train.h"

#include "malus/neural/trainer.h"

namespace malus::app {

nlohmann::ordered_json train_network(const TrainCall& call, Progress& progress) {
  const TrainingConfig config = load_training_config(call.config);
  const auto workers =
      workers_of_environment(config.train.timeout_s, training_device(config.train));
  return train(
      config,
      {.folder = call.folder, .resume = call.resume, .force = call.force, .seed = call.seed},
      *workers, progress);
}

}  // namespace malus::app
