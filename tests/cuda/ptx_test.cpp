// The device code that nvcc writes, run instruction by instruction on the CPU (ptx_to_cpp.py): its
// random words and its noise are the CPU sampler's, bit for bit. Needs no device.
#include "malus/cuda/internal/draw_plan.h"

#include <cmath>
#include <limits>
#include <ostream>
#include <string>
#include <vector>

#include "../synthesize/sixteen_channels.h"
#include "ptx_place.h"
#include "same_bits.h"
#include <gtest/gtest.h>

namespace malus {
namespace testing {
void draw_noise_ptx(int kernel, const ptx::Place& place, const unsigned char* const* parameters);
}

namespace {

using testing::expect_same_bits;
using testing::levels;
using testing::sixteen_channels;

// What apply_on_device does, the grid's threads one after the other and host memory as the
// device's.
void draw_by_ptx(const CompiledNoise& noise, View<const float> clean, View<float> noisy,
                 const DrawAddress& address) {
  const CompiledParts& parts = noise.parts();
  const cuda::DrawPlan plan = cuda::plan_draw(parts, clean.data(), clean.stride(), noisy.data(),
                                              noisy.stride(), clean.rows(), clean.cols(), address);
  const FormationTables tables{normal_tail_lines().data(),
                               parts.read_lines ? parts.read_lines->data() : nullptr, parts.shot,
                               parts.quantization_dn};
  const CompiledChannel* channels = parts.channels.data();
  const float* deviates = plan.row_deviate.data();
  const auto bytes = [](const auto& value) {
    return reinterpret_cast<const unsigned char*>(&value);
  };
  const unsigned char* const parameters[] = {bytes(plan.frame), bytes(tables), bytes(channels),
                                             bytes(deviates)};
  const cuda::DrawGrid& grid = plan.grid;
  testing::ptx::Place place{.threads = {grid.threads_x, grid.threads_y, 1}};
  for (place.block[1] = 0; place.block[1] < grid.blocks_y; ++place.block[1])
    for (place.block[0] = 0; place.block[0] < grid.blocks_x; ++place.block[0])
      for (place.thread[1] = 0; place.thread[1] < grid.threads_y; ++place.thread[1])
        for (place.thread[0] = 0; place.thread[0] < grid.threads_x; ++place.thread[0])
          testing::draw_noise_ptx(static_cast<int>(plan.kernel), place, parameters);
}

struct Kind {
  const char* name;
  CompiledNoise (*noise)();
  friend void PrintTo(const Kind& kind, std::ostream* out) { *out << kind.name; }
};

class Ptx : public ::testing::TestWithParam<Kind> {};

TEST_P(Ptx, DrawsTheCpusBitsAtAnySizeAndPlace) {
  const CompiledNoise noise = GetParam().noise();
  for (const int cols : {1, 15, 31, 200, 333})
    for (const DrawAddress& place :
         {DrawAddress{.seed = 7},
          DrawAddress{.seed = 0xABCDEF0123456789, .frame = 5, .row0 = 3, .col0 = 45}}) {
      const Image clean = levels(67, cols);
      Image cpu(67, cols), gpu(67, cols, -1.0f);
      noise.apply(clean, cpu, place);
      draw_by_ptx(noise, clean, gpu, place);
      expect_same_bits(cpu, gpu);
    }
}

TEST_P(Ptx, DrawsInPlaceIntoPartOfAnImage) {
  const CompiledNoise noise = GetParam().noise();
  const DrawAddress place{.seed = 3, .row0 = 8, .col0 = 100};
  Image cpu = levels(40, 300), gpu = cpu;
  noise.apply(cpu.view().window(8, 100, 20, 150), cpu.view().window(8, 100, 20, 150), place);
  draw_by_ptx(noise, gpu.view().window(8, 100, 20, 150), gpu.view().window(8, 100, 20, 150), place);
  expect_same_bits(cpu, gpu);
}

TEST_P(Ptx, KeepsWhatIsNoNumber) {
  const CompiledNoise noise = GetParam().noise();
  Image clean(4, 64, 10.0f);
  clean(0, 0) = std::numeric_limits<float>::quiet_NaN();
  clean(1, 33) = std::numeric_limits<float>::infinity();
  clean(2, 20) = -std::numeric_limits<float>::infinity();
  Image cpu(4, 64), gpu(4, 64);
  noise.apply(clean, cpu, {});
  draw_by_ptx(noise, clean, gpu, {});
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 64; ++c) {
      ASSERT_EQ(std::isnan(cpu(r, c)), std::isnan(gpu(r, c)));
      if (!std::isnan(cpu(r, c))) {
        ASSERT_EQ(cpu(r, c), gpu(r, c));
      }
    }
}

// Large enough that a thread draws two rows, the last of them not in every thread, and each of its
// rows with other signals and another row deviate.
TEST_P(Ptx, DrawsSeveralRowsPerThreadOfChangingSignals) {
  const CompiledNoise noise = GetParam().noise();
  const DrawAddress place{.seed = 11, .frame = 2, .row0 = 5, .col0 = 45};
  constexpr int kRows = 1027, kCols = 1100;
  Image clean(kRows, kCols);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c)
      clean(r, c) =
          static_cast<float>((r * 7919 + c * 104729) % 4001) * (r % 3 == 0 ? 0.01f : 1) - 1;
  const cuda::DrawPlan plan =
      cuda::plan_draw(noise.parts(), nullptr, kCols, nullptr, kCols, kRows, kCols, place);
  ASSERT_GE(plan.frame.rows_per_thread, 2);
  ASSERT_NE(kRows % (plan.frame.rows_per_thread * plan.frame.rows_apart), 0);
  Image cpu(kRows, kCols), gpu(kRows, kCols, -1.0f);
  noise.apply(clean, cpu, place);
  draw_by_ptx(noise, clean, gpu, place);
  expect_same_bits(cpu, gpu);
}

// About 30 of these pixels are redrawn in double precision, whose exp is another one on the device.
TEST_P(Ptx, DrawsTheFarTailOfFewElectrons) {
  const CompiledNoise noise = GetParam().noise();
  const Image clean(1024, 2048, 1.5f);
  Image cpu(1024, 2048), gpu(1024, 2048);
  noise.apply(clean, cpu, {.seed = 1});
  draw_by_ptx(noise, clean, gpu, {.seed = 1});
  expect_same_bits(cpu, gpu);
}

CompiledNoise physics() { return CompiledNoise(sixteen_channels()); }

CompiledNoise poisson_gaussian() { return CompiledNoise::poisson_gaussian(sixteen_channels()); }

CompiledNoise gaussian() {
  std::vector<GaussianChannel> channels;
  for (int c = 0; c < 4; ++c)
    channels.push_back(
        {.slope_dn = 0.5 + 0.1 * c, .offset_dn2 = 2.0 - c, .sigma_row_dn = 0.3, .mu_dn = 0.1 * c});
  return CompiledNoise::gaussian(SensorLayout::named("bayer-rggb"), channels, 1, 0.5);
}

CompiledNoise shot_only() {
  PhysicsNoise noise = sixteen_channels();
  noise.parts = {.shot = true, .read = false, .row = false, .quantization = false, .bias = false};
  return CompiledNoise(noise);
}

// Three channels side by side: the two pixels of a random block are of different channels.
CompiledNoise three_columns() {
  PhysicsNoise noise = sixteen_channels();
  noise.layout = SensorLayout::from_sites({{"R", "G1", "B"}});
  noise.channels.resize(3);
  return CompiledNoise(noise);
}

CompiledNoise rounded_later() { return physics().without_quantization(); }

INSTANTIATE_TEST_SUITE_P(Kinds, Ptx,
                         ::testing::Values(Kind{"physics", physics},
                                           Kind{"poisson_gaussian", poisson_gaussian},
                                           Kind{"gaussian", gaussian}, Kind{"shot_only", shot_only},
                                           Kind{"three_columns", three_columns},
                                           Kind{"rounded_later", rounded_later}),
                         [](const auto& kind) { return std::string(kind.param.name); });

}  // namespace
}  // namespace malus
