#include "malus/neural/gpu.h"

#include <ATen/Context.h>

namespace malus {

void choose_fast_gpu_kernels() { at::globalContext().setBenchmarkCuDNN(true); }

bool prefers_channels_last(const std::string&) {
  // unet, nafnet and restormer are convolutions and norms over a pixel's channels; uformer and
  // malus keep [batch, row, column, channel] between their convolutions.
  return true;
}

torch::Tensor placed(const torch::Tensor& planes, const torch::Device& device, bool channels_last) {
  const auto moved = planes.to(device);
  return channels_last ? moved.contiguous(torch::MemoryFormat::ChannelsLast) : moved;
}

void place_network(Network& network, const torch::Device& device, bool channels_last) {
  network.to(device);
  if (!channels_last) return;
  const torch::NoGradGuard no_gradients;
  for (torch::Tensor& parameter : network.parameters())
    if (parameter.dim() == 4)
      parameter.set_data(parameter.data().contiguous(torch::MemoryFormat::ChannelsLast));
}

}  // namespace malus
