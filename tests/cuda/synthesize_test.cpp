// The GPU's noise is the CPU's, bit for bit. Skipped, never passed, where no device answers.
#include "malus/cuda/synthesize.h"

#include "malus/base/error.h"
#include "malus/cuda/device.h"

#include <bit>
#include <cstdint>

#include <gtest/gtest.h>

namespace malus {
namespace {

PhysicsNoise sixteen_channels() {
  PhysicsNoise noise;
  noise.layout = SensorLayout::named("polar-bayer-rggb");
  for (int c = 0; c < 16; ++c)
    noise.channels.push_back({.gain_dn_per_e = 0.4 + 0.05 * c,
                              .lambda = -0.2 + 0.03 * c,
                              .mu_dn = -2.0 + 0.1 * c,
                              .sigma_tl_dn = 0.8 + 0.05 * c,
                              .sigma_row_dn = 0.2});
  noise.row_group = 2;
  return noise;
}

TEST(DeviceNoise, EqualsTheCpuBitForBit) {
  if (!cuda::device_available()) GTEST_SKIP() << "no CUDA device answers";
  const CompiledNoise compiled(sixteen_channels());
  const cuda::DeviceNoise device(compiled);
  for (const int cols : {1, 31, 200, 333}) {
    Image clean(67, cols), cpu(67, cols), gpu(67, cols);
    for (int r = 0; r < 67; ++r)
      for (int c = 0; c < cols; ++c)
        clean(r, c) =
            static_cast<float>((r * 31 + c * 17) % 97) * 0.7f - 5.0f + static_cast<float>(r * r);
    const DrawAddress place{.seed = 0xABCDEF0123456789, .frame = 5, .row0 = 3, .col0 = 45};
    compiled.apply(clean.view(), cpu.view(), place);
    device.apply(clean, gpu, place);
    for (int r = 0; r < 67; ++r)
      for (int c = 0; c < cols; ++c)
        ASSERT_EQ(std::bit_cast<std::uint32_t>(cpu(r, c)), std::bit_cast<std::uint32_t>(gpu(r, c)))
            << r << ' ' << c << ' ' << cpu(r, c) << ' ' << gpu(r, c);
  }
}

TEST(DeviceNoise, SaysWhenThereIsNoDevice) {
  if (cuda::device_available()) GTEST_SKIP() << "a CUDA device answers";
  EXPECT_THROW(cuda::DeviceNoise(CompiledNoise(sixteen_channels())), InputError);
}

}  // namespace
}  // namespace malus
