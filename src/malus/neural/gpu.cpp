#include "malus/neural/gpu.h"

#include "malus/base/error.h"
#include "malus/base/worker_place.h"
#include "malus/neural/internal/autocast.h"

#include <ATen/Context.h>

namespace malus {

torch::Device training_device(const TrainSettings& settings) {
  const bool there = torch::cuda::is_available();
  if (settings.device == "cuda" && !there)
    throw InputError("device = \"cuda\"", "this libtorch finds no GPU", "use device = \"cpu\"");
  if (settings.device == "cpu" || !there) return torch::kCPU;
  // Each process of a machine takes its own GPU.
  const int gpus = static_cast<int>(torch::cuda::device_count());
  return {torch::kCUDA, static_cast<c10::DeviceIndex>(local_rank_of_environment() % gpus)};
}

bool wants_bfloat16(const TrainingConfig& config) {
  if (config.train.precision != "bfloat16") return false;
  const std::string& architecture = config.package.network.architecture;
  if (!autocast_suits(architecture))
    throw InputError(config.source.string(), "precision = \"bfloat16\" is not for " + architecture,
                     "use \"auto\" or \"float32\"");
  return true;
}

void choose_fast_gpu_kernels() { at::globalContext().setBenchmarkCuDNN(true); }

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
