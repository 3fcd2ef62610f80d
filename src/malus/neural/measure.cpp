#include "malus/neural/measure.h"

#include "malus/base/stopwatch.h"
#include "malus/neural/internal/packed.h"
#include "malus/neural/network.h"

#include <algorithm>
#include <ctime>
#include <fstream>
#include <string>

#include <ATen/record_function.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace malus {
namespace {

thread_local double multiplications = 0;

// Deviation of what is added to the weights: nafnet starts with branches that count nothing.
constexpr double kScatter = 0.02;

double size_of(const torch::IValue& value, std::int64_t dimension) {
  return static_cast<double>(value.toTensor().size(dimension));
}

// Multiplications of one operation, from its inputs.
double work_of(const at::RecordFunction& call) {
  const std::string_view name = call.name();
  const auto inputs = call.inputs();
  if (name == "aten::mm")
    return size_of(inputs[0], 0) * size_of(inputs[0], 1) * size_of(inputs[1], 1);
  if (name == "aten::addmm")
    return size_of(inputs[1], 0) * size_of(inputs[1], 1) * size_of(inputs[2], 1);
  if (name == "aten::bmm")
    return size_of(inputs[0], 0) * size_of(inputs[0], 1) * size_of(inputs[0], 2) *
           size_of(inputs[1], 2);
  if (name == "aten::convolution") {
    const auto &x = inputs[0].toTensor(), &weight = inputs[1].toTensor();
    const bool transposed = inputs[6].toBool();
    const auto stride = inputs[3].toIntVector();
    double places = static_cast<double>(x.size(0) * x.size(2) * x.size(3));
    if (!transposed) places /= static_cast<double>(stride[0] * stride[1]);
    return places * static_cast<double>(weight.numel());
  }
  return 0;
}

std::unique_ptr<at::ObserverContext> count(const at::RecordFunction& call) {
  multiplications += work_of(call);
  return nullptr;
}

// The layers of libtorch are counted: without gradients the kernels would take their place.
double count_work(Network& network, const torch::Tensor& input) {
  const torch::AutoGradMode gradients(true);
  for (torch::Tensor& parameter : network.parameters()) parameter.set_requires_grad(false);
  multiplications = 0;
  const auto handle = at::addThreadLocalCallback(
      at::RecordFunctionCallback(count).needsInputs(true).scopes({at::RecordScope::FUNCTION}));
  network.forward(input);
  at::removeCallback(handle);
  return multiplications;
}

// A line of this process's memory in the kernel's account [bytes]; 0 where there is none.
double memory_of_process(const std::string& line) {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;)
    if (double kibibytes = 0; word == line && status >> kibibytes) return 1024 * kibibytes;
  return 0;
}

// Resident memory that work needs at most beyond what there was before.
template <class Work>
double peak_bytes(const Work& work) {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
  // Sets the account's peak back to what is resident now (proc(5), clear_refs).
  if (!(std::ofstream("/proc/self/clear_refs") << "5" << std::flush)) return 0;
  const double before = memory_of_process("VmRSS:");
  work();
  return memory_of_process("VmHWM:") - before;
}

NetworkCost::Time time_of(Network& network, const torch::Tensor& input, int repetitions) {
  std::vector<double> times, processor_times;
  for (int i = 0; i < repetitions; ++i) {
    const Stopwatch stopwatch;
    const std::clock_t processor_start = std::clock();
    network.forward(input);
    processor_times.push_back(static_cast<double>(std::clock() - processor_start) / CLOCKS_PER_SEC);
    times.push_back(stopwatch.seconds());
  }
  std::nth_element(times.begin(), times.begin() + std::ssize(times) / 2, times.end());
  return {times[times.size() / 2],
          *std::min_element(processor_times.begin(), processor_times.end())};
}

}  // namespace

NetworkCost measure_network(const NamedNetwork& named, int channels, int rows, int cols,
                            int repetitions) {
  const torch::NoGradGuard no_gradients;
  torch::manual_seed(1);
  const auto network = make_network({named.architecture, named.settings});
  network->eval();
  for (torch::Tensor& parameter : network->parameters())
    parameter.add_(kScatter * torch::randn_like(parameter));
  const auto input = torch::rand({1, channels, rows, cols});
  NetworkCost cost;
  cost.parameters = parameter_count(*network);
  cost.multiply_adds = count_work(*network, input);
  if (repetitions == 0) return cost;
  const auto exact = network->forward(input);  // packs the weights
  cost.peak_bytes = peak_bytes([&] { network->forward(input); });
  cost.float32 = time_of(*network, input, repetitions);
  if (!internal::can_round_products()) return cost;
  const internal::RoundedProducts rounding(true);
  const auto loss = (network->forward(input) - exact).square().mean().sqrt() / exact.std();
  cost.bfloat16_difference = loss.item<double>();
  cost.bfloat16 = time_of(*network, input, repetitions);
  return cost;
}

}  // namespace malus
