// The GPU's noise is the CPU's, bit for bit. Skipped, never passed, where no device answers.
#include "malus/cuda/synthesize.h"

#include "malus/base/error.h"
#include "malus/cuda/device.h"
#include "malus/cuda/internal/rounding.h"

#include <cstdio>

#include "../synthesize/sixteen_channels.h"
#include "same_bits.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::expect_same_bits;
using testing::levels;
using testing::sixteen_channels;

TEST(DeviceNoise, EqualsTheCpuBitForBit) {
  if (!cuda::device_available()) GTEST_SKIP() << "no CUDA device answers";
  const CompiledNoise compiled(sixteen_channels());
  const cuda::DeviceNoise device(compiled);
  for (const int cols : {1, 31, 200, 333}) {
    const Image clean = levels(67, cols);
    Image cpu(67, cols), gpu(67, cols);
    const DrawAddress place{.seed = 0xABCDEF0123456789, .frame = 5, .row0 = 3, .col0 = 45};
    compiled.apply(clean.view(), cpu.view(), place);
    device.apply(clean, gpu, place);
    expect_same_bits(cpu, gpu);
  }
}

// What DeviceNoise rests on beyond IEEE 754: another generation of GPUs may differ.
TEST(DeviceNoise, RoundsEveryRootAndReciprocal) {
  if (!cuda::device_available()) GTEST_SKIP() << "no CUDA device answers";
  const cuda::RoundingDifferences differences = cuda::rounding_differences();
  EXPECT_EQ(differences.roots, 0u);
  EXPECT_EQ(differences.reciprocals, 0u);
}

// 4 Gpx/s of floats fill a PCIe 4 link: drawing must not be what a frame waits for.
TEST(DeviceNoise, DrawsFasterThanFramesCanBeFetched) {
  if (!cuda::device_available()) GTEST_SKIP() << "no CUDA device answers";
  const cuda::DeviceRates rates =
      cuda::measure_rates(CompiledNoise(sixteen_channels()), 16384, 16384, 4000);
  std::printf("  %s: %.1f Gpx/s drawn, %.1f copied on the device\n", cuda::device_name().c_str(),
              1e-9 * rates.drawn, 1e-9 * rates.copied);
  EXPECT_GE(rates.drawn, 4e9);
}

TEST(DeviceNoise, SaysWhenThereIsNoDevice) {
  if (cuda::device_available()) GTEST_SKIP() << "a CUDA device answers";
  EXPECT_THROW(cuda::DeviceNoise(CompiledNoise(sixteen_channels())), InputError);
}

}  // namespace
}  // namespace malus
