#include "malus/cuda/device.h"
#include "malus/cuda/internal/device_memory.h"
#include "malus/cuda/internal/lane_arithmetic.h"
#include "malus/cuda/internal/rounding.h"

#include <cuda_runtime.h>

namespace malus::cuda {
namespace {

// Finite floats from kShotSmall on by their bits, which are in the order of the numbers.
constexpr std::uint32_t kFirst = 0x40A00000u, kPast = 0x7F800000u;
// 2^126: above it a reciprocal is subnormal, and rounded_reciprocal zero.
constexpr std::uint32_t kReciprocalLast = 0x7E800000u;

__global__ void count_differences(unsigned* roots, unsigned* reciprocals) {
  const std::uint32_t step = gridDim.x * blockDim.x;
  unsigned root = 0, reciprocal = 0;
  // The step does not carry past 2^32: kPast is below 2^31.
  for (std::uint32_t bits = kFirst + blockIdx.x * blockDim.x + threadIdx.x; bits < kPast;
       bits += step) {
    const float a = __uint_as_float(bits);
    root += __float_as_uint(rounded_sqrt(a)) != __float_as_uint(__fsqrt_rn(a));
    if (bits <= kReciprocalLast)
      reciprocal += __float_as_uint(rounded_reciprocal(a)) != __float_as_uint(__frcp_rn(a));
  }
  atomicAdd(roots, root);
  atomicAdd(reciprocals, reciprocal);
}

}  // namespace

RoundingDifferences rounding_differences() {
  check_status(device_available() ? cudaSuccess : cudaErrorNoDevice, "looking for a device");
  const DeviceArray<unsigned> counts(std::vector<unsigned>(2, 0u));
  count_differences<<<1024, 256>>>(counts.get(), counts.get() + 1);
  check_status(cudaGetLastError(), "starting the kernel");
  unsigned found[2];
  check_status(cudaMemcpy(found, counts.get(), sizeof(found), cudaMemcpyDeviceToHost),
               "copying from the device");
  return {found[0], found[1]};
}

}  // namespace malus::cuda
