#include "malus/neural/device_speed.h"

#include "malus/base/error.h"
#include "malus/base/stopwatch.h"
#include "malus/base/wording.h"
#include "malus/neural/gpu.h"
#include "malus/neural/internal/autocast.h"
#include "malus/neural/internal/optimizer.h"
#include "malus/neural/internal/recorded_pass.h"
#include "malus/neural/loss.h"

#include <algorithm>
#include <cmath>
#include <string_view>

#include <ATen/Context.h>

namespace malus {
namespace {

// A device works while the program goes on: it is waited for once per block of steps, which is long
// enough for the wait to count nothing. The same in bench/peers/networks_torch.py.
constexpr int kWarmUpSteps = 5, kBlocks = 5;
constexpr double kBlockSeconds = 0.15;

struct Setup {
  torch::Device device;
  bool training, bfloat16, channels_last;
};

torch::Device device_of(const std::string& name) {
  if (name == "cpu") return torch::kCPU;
  if (!torch::cuda::is_available())
    throw InputError(setting("device", name), "this libtorch finds no CUDA device",
                     "leave it out, or build with a libtorch that has CUDA");
  return torch::kCUDA;
}

template <class Step>
double steps_per_s(const torch::Device& device, bool once, const Step& step) {
  const auto time_of = [&](int steps) {
    const Stopwatch stopwatch;
    for (int i = 0; i < steps; ++i) step();
    if (device.is_cuda()) torch::cuda::synchronize();
    return stopwatch.seconds();
  };
  if (once) return 1 / time_of(1);
  time_of(kWarmUpSteps);
  const int steps = std::max(1, static_cast<int>(std::ceil(kBlockSeconds / time_of(1))));
  std::vector<double> times;
  for (int i = 0; i < kBlocks; ++i) times.push_back(time_of(steps));
  std::nth_element(times.begin(), times.begin() + kBlocks / 2, times.end());
  return steps / times[kBlocks / 2];
}

double inference_steps_per_s(Network& network, const torch::Tensor& input, const Setup& setup,
                             bool once) {
  const torch::InferenceMode no_gradients;
  network.eval();
  return steps_per_s(setup.device, once, [&] {
    const Autocast autocast(setup.bfloat16, setup.device.is_cuda());
    network.forward(input);
  });
}

double training_steps_per_s(Network& network, const torch::Tensor& input, const Setup& setup,
                            bool once) {
  constexpr double kRate = 1e-5, kBeta1 = 0.9, kBeta2 = 0.999;
  network.train();
  const auto parameters = network.parameters();
  Adam adam(parameters, kBeta1, kBeta2);
  const TrainingExample batch{input, torch::rand_like(input)};
  RecordedPass pass(
      parameters,
      [&](const TrainingExample& example) -> StepLosses {
        const Autocast autocast(setup.bfloat16, setup.device.is_cuda());
        const auto output = network.forward(example.input).to(torch::kFloat32);
        const auto loss = l1_distance(output, example.target);
        return {loss, loss};
      },
      true);
  std::int64_t count = 0;
  return steps_per_s(setup.device, once, [&] {
    pass(batch);
    adam.update(kRate, count++);
  });
}

// 0 where the device's memory does not suffice.
double images_per_s(const NamedNetwork& named, const DeviceWork& work, const Setup& setup) {
  const int batch = setup.training ? work.training_batch : work.inference_batch,
            side = setup.training ? work.training_side : work.inference_side;
  try {
    torch::manual_seed(1);
    const auto network = make_network({named.architecture, named.settings});
    place_network(*network, setup.device, setup.channels_last);
    const auto input =
        placed(torch::rand({batch, work.channels, side, side}), setup.device, setup.channels_last);
    return batch * (setup.training ? training_steps_per_s(*network, input, setup, work.once)
                                   : inference_steps_per_s(*network, input, setup, work.once));
  } catch (const c10::Error& error) {
    if (std::string_view(error.what_without_backtrace()).find("out of memory") ==
        std::string_view::npos)
      throw;
    return 0;
  }
}

}  // namespace

std::vector<DeviceSpeed> measure_device_speed(const NamedNetwork& network, const DeviceWork& work) {
  const torch::Device device = device_of(work.device);
  choose_fast_gpu_kernels();
  std::vector<DeviceSpeed> speeds;
  for (const bool training : {false, true})
    for (const bool bfloat16 : {false, true}) {
      if (bfloat16 && !autocast_suits(network.architecture)) continue;
      speeds.push_back({.work = training ? "training" : "inference",
                        .precision = bfloat16 ? "bfloat16" : "float32",
                        .images_per_s = images_per_s(network, work,
                                                     {.device = device,
                                                      .training = training,
                                                      .bfloat16 = bfloat16,
                                                      .channels_last = kChannelsLast}),
                        .channels_last = kChannelsLast,
                        .other_order_images_per_s = images_per_s(network, work,
                                                                 {.device = device,
                                                                  .training = training,
                                                                  .bfloat16 = bfloat16,
                                                                  .channels_last = !kChannelsLast}),
                        .tf32_convolutions = at::globalContext().allowTF32CuDNN(),
                        .tf32_products = at::globalContext().allowTF32CuBLAS()});
    }
  return speeds;
}

}  // namespace malus
