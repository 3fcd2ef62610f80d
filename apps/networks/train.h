// `malus train` behind the door.
#pragma once

#include "networks.h"

namespace malus::app {

/// Throws InputError where the configuration cannot be trained: keys, files, sizes of the network.
void check_training(const TrainCall& call);
/// Trains as the configuration says, with the workers that the environment names; result: the
/// record of malus/neural/trainer.h. Throws InputError, Cancelled.
nlohmann::ordered_json train_network(const TrainCall& call, Progress& progress);

}  // namespace malus::app
