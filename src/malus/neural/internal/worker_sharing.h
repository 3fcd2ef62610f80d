// What the processes that train one network together tell each other.
#pragma once

#include "malus/neural/internal/checkpoint.h"
#include "malus/neural/workers.h"

#include <vector>

#include <torch/torch.h>

namespace malus {

/// The others begin with what worker 0 holds: step, first loss, refresh, weights, their average and
/// Adam's moments. device: that messages go through. Returns worker 0's at_end. One process alone
/// changes nothing. Throws as Workers does.
bool take_leaders_state(Workers& workers, TrainingState& state, bool at_end,
                        const torch::Device& device);

/// The parameters' gradients become their mean over the workers, in one message with `told`, one
/// row of values, whose mean is returned. A parameter without a gradient keeps none. Throws as
/// Workers does.
torch::Tensor mean_over_workers(Workers& workers, const std::vector<torch::Tensor>& parameters,
                                const torch::Tensor& told);

}  // namespace malus
