#include "malus/cuda/device.h"
#include "malus/cuda/internal/device_memory.h"
#include "malus/cuda/synthesize.h"

#include <algorithm>
#include <vector>

#include <cuda_runtime.h>

namespace malus::cuda {
namespace {

// Seconds of work() by the device's clock: of several one after the other, because the host
// prepares a frame while the device draws the one before; the median of some such runs.
template <class Work>
double device_seconds(const Work& work) {
  constexpr int kRepetitions = 9, kInARow = 8;
  cudaEvent_t start{}, stop{};
  check_status(cudaEventCreate(&start), "timing");
  check_status(cudaEventCreate(&stop), "timing");
  std::vector<float> times;
  for (int i = 0; i < kRepetitions; ++i) {
    check_status(cudaEventRecord(start), "timing");
    for (int k = 0; k < kInARow; ++k) work();
    check_status(cudaEventRecord(stop), "timing");
    check_status(cudaEventSynchronize(stop), "timing");
    times.push_back(0);
    check_status(cudaEventElapsedTime(&times.back(), start, stop), "timing");
  }
  cudaEventDestroy(start);
  cudaEventDestroy(stop);
  std::nth_element(times.begin(), times.begin() + kRepetitions / 2, times.end());
  return 1e-3 * static_cast<double>(times[kRepetitions / 2]) / kInARow;
}

}  // namespace

DeviceRates measure_rates(const CompiledNoise& noise, int rows, int cols, double top_dn) {
  const DeviceNoise device(noise);
  const auto pixels = static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols);
  std::vector<float> signals_dn(pixels);
  for (std::size_t i = 0; i < pixels; ++i)
    signals_dn[i] =
        static_cast<float>(top_dn * uniform_open(static_cast<std::uint32_t>(i) * 2654435761u));
  const DeviceArray<float> clean(signals_dn), noisy(pixels);
  const double drawn_s = device_seconds([&] {
    device.apply_on_device(clean.get(), cols, noisy.get(), cols, rows, cols, {.seed = 1});
  });
  const double copied_s = device_seconds([&] {
    check_status(
        cudaMemcpyAsync(noisy.get(), clean.get(), pixels * sizeof(float), cudaMemcpyDeviceToDevice),
        "copying on the device");
  });
  return {static_cast<double>(pixels) / drawn_s, static_cast<double>(pixels) / copied_s};
}

}  // namespace malus::cuda
