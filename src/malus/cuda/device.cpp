#include "malus/cuda/device.h"

#include "malus/base/error.h"

#include <cuda_runtime_api.h>

namespace malus::cuda {

bool device_available() {
  int count = 0;
  return cudaGetDeviceCount(&count) == cudaSuccess && count > 0;
}

std::string device_name() {
  cudaDeviceProp properties{};
  check_status(cudaGetDeviceProperties(&properties, 0), "asking for its name");
  return properties.name;
}

void check_status(int status, const char* what) {
  if (status != cudaSuccess)
    throw InputError(
        "CUDA device",
        std::string(what) + ": " + cudaGetErrorString(static_cast<cudaError_t>(status)),
        "check the driver with nvidia-smi, or run without CUDA");
}

}  // namespace malus::cuda
