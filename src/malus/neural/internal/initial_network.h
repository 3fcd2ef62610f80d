// The weights that a training run starts from.
#pragma once

#include "malus/neural/network.h"
#include "malus/neural/training_config.h"

#include <cstdint>
#include <memory>

namespace malus {

/// On the CPU, a function of the seed: those of config.begin_with if it names a file, else random
/// ones; a residual network then begins by returning its base. Throws InputError when the file
/// cannot be read or is of a network that takes or gives something else.
std::shared_ptr<Network> initial_network(const TrainingConfig& config, std::uint64_t seed);

}  // namespace malus
