// What makes libtorch fast on a GPU: settings and the order of memory.
#pragma once

#include "malus/neural/network.h"
#include "malus/neural/training_config.h"

#include <torch/torch.h>

namespace malus {

/// "auto" resolved. Throws InputError where a GPU is asked for and there is none.
torch::Device training_device(const TrainSettings& settings);

/// Whether precision = "bfloat16" asks for it. Throws InputError for networks that it does not
/// suit.
bool wants_bfloat16(const TrainingConfig& config);

/// cuDNN tries its algorithms on the first pass of every shape and keeps the fastest: for work that
/// meets few shapes often. TF32 stays as libtorch sets it.
void choose_fast_gpu_kernels();

/// The order of memory on a GPU: a pixel's channels together (NHWC). unet, nafnet and restormer are
/// convolutions and norms over a pixel's channels; uformer and malus keep [batch, row, column,
/// channel] between their convolutions. Measured for unet and nafnet (docs/networks.md).
inline constexpr bool kChannelsLast = true;

/// Moves a network, and brings the weights of its convolutions into that order where it is wanted.
/// Optimisers and averages made from its parameters afterwards have the same order.
void place_network(Network& network, const torch::Device& device, bool channels_last);
/// The same for a batch of planes.
torch::Tensor placed(const torch::Tensor& planes, const torch::Device& device, bool channels_last);

}  // namespace malus
