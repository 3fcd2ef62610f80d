// BM3D: a 512x512 grey picture on one thread and on all, a 16-channel frame of 5 megapixels,
// against copying the picture.
#include "malus/base/parallel.h"
#include "malus/base/random.h"
#include "malus/base/text.h"
#include "malus/denoise/bm3d.h"

#include <cmath>
#include <cstring>
#include <span>

#include "benchmarks.h"
#include "freed_memory.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

constexpr float kSigma = 25;

/// Smooth shades, edges and a texture under noise.
Planes noisy_picture(int channels, int rows, int cols) {
  Planes planes(channels, rows, cols);
  for (int ch = 0; ch < channels; ++ch) {
    RandomSequence random(1, static_cast<std::uint32_t>(ch), Draw::kOther);
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        const double shade = 110 + 60 * std::sin(0.011 * r + 0.1 * ch) * std::cos(0.017 * c);
        const double edge = (r + c / 2) / 70 % 2 == 0 ? 40 : 0;
        const double texture = c / 120 % 3 == 1 ? 15 * std::sin(0.9 * r + 0.4 * c) : 0;
        planes[ch](r, c) = static_cast<float>(shade + edge + texture + kSigma * random.normal());
      }
  }
  return planes;
}

std::vector<BenchmarkLine> bm3d_lines(const BenchmarkContext& context) {
  keep_freed_planes();  // as `malus denoise` does
  std::vector<BenchmarkLine> lines;
  const int all = thread_count(), side = context.quick ? 64 : 512;
  const std::string size = fmt::format("{}x{} grey", side, side);
  const Planes grey = noisy_picture(1, side, side);
  Planes copy(1, side, side);
  lines.push_back({"copying the picture", 1e3 * context.time_s([&] {
                     std::memcpy(copy[0].values().data(), grey[0].values().data(),
                                 grey[0].size() * sizeof(float));
                   }),
                   "ms", size});
  const auto time_profile = [&](const std::string& profile, int threads) {
    set_thread_count(threads);
    const double seconds =
        context.time_s([&] { (void)bm3d(grey, std::span(&kSigma, 1), {.profile = profile}); }, 5);
    lines.push_back({profile + ", " + counted(threads, "thread"), 1e3 * seconds, "ms", size});
  };
  for (const std::string& profile : denoise_profile_names()) {
    time_profile(profile, 1);
    if (all > 1) time_profile(profile, all);
  }
  set_thread_count(all);

  const Planes packed = context.quick ? noisy_picture(16, 48, 64) : noisy_picture(16, 512, 612);
  const std::vector<float> sigma(16, kSigma);
  std::vector<float> matched(16, 0.0F);
  std::fill_n(matched.begin(), 3, 1.0F);
  lines.push_back(
      {"normal, 16 channels, " + counted(all, "thread"),
       context.time_s([&] { (void)bm3d(packed, sigma, {.profile = "normal"}, matched); }, 3), "s",
       fmt::format("{} x {}x{}, matched on three channels", packed.channels(), packed.cols(),
                   packed.rows())});
  return lines;
}

}  // namespace

Benchmark benchmark_bm3d() { return {"bm3d", bm3d_lines}; }

}  // namespace malus::app
