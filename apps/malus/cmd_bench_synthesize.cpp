// Noise synthesis: the compiled sampler against the plain definition and against copying the frame.
#include "malus/base/parallel.h"
#include "malus/base/text.h"
#ifdef MALUS_WITH_CUDA
#include "malus/cuda/device.h"
#include "malus/cuda/synthesize.h"
#endif
#include "malus/noise/model.h"
#include "malus/synthesize/compiled.h"
#include "malus/synthesize/compiled_kernel.h"
#include "malus/synthesize/level_sampler.h"
#include "malus/synthesize/synthesizer.h"

#include <cstring>

#include "benchmarks.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

constexpr int kRows = 2048, kCols = 2448;

// Equally many pixels at every level from 0 to `top`, in no order.
Image spread_signals(int rows, int cols, double top) {
  Image image(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const auto number = static_cast<std::uint32_t>(r * cols + c) * 2654435761u;
      image(r, c) = static_cast<float>(top * uniform_open(number));
    }
  return image;
}

void copy(const Image& from, Image& to) {
  parallel_for(0, from.rows(), 64, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    std::memcpy(to.row(static_cast<int>(begin)), from.row(static_cast<int>(begin)),
                static_cast<std::size_t>(end - begin) * static_cast<std::size_t>(from.cols()) *
                    sizeof(float));
  });
}

// 001's kind of model: 256 levels, 128 bins.
NonparametricCalibration levels_of(int channels) {
  NonparametricChannel channel;
  for (int l = 0; l < 256; ++l) {
    channel.level_dn.push_back(16.0 * l);
    channel.pmf.emplace_back();
    for (int b = 0; b < 128; ++b) channel.pmf.back().push_back(1.0 + (b * 37 + l) % 64);
  }
  for (int b = 0; b <= 128; ++b) channel.bin_edges_dn.push_back(2.0 * (b - 64));
  NonparametricCalibration calibration;
  calibration.channels.assign(static_cast<std::size_t>(channels), channel);
  return calibration;
}

struct SynthesisBenchmark {
  const BenchmarkContext& context;
  int rows;
  double megapixels;
  std::vector<BenchmarkLine> lines;

  double rate(const std::string& name, const std::function<void()>& work,
              const std::string& remark = "", int repetitions = 15) {
    const double value = megapixels / context.time_s(work, repetitions);
    lines.push_back({name, value, "Mpx/s", remark});
    return value;
  }
};

// What a training loop pays per patch: one thread's draw of 256 x 256, parameters included.
void add_patch_lines(SynthesisBenchmark& bench, const NoiseModel& model, const GainSetting& gain) {
  constexpr int kPatch = 256, kDraws = 50;
  const Synthesizer synthesizer(model, {});
  const Image clean = spread_signals(kPatch, kPatch, 2000.0);
  Image noisy(kPatch, kPatch);
  std::uint32_t frame = 0;
  const auto time_of = [&](const std::string& name, const std::optional<GainSetting>& at) {
    const double seconds = bench.context.time_s(
        [&] {
          for (int i = 0; i < kDraws; ++i)
            synthesizer.draw_into(clean, noisy, at, {.seed = 1, .frame = ++frame});
        },
        9);
    bench.lines.push_back({name, 1e3 * seconds / kDraws, "ms", "256 x 256, parameters sampled"});
  };
  time_of("a patch at one gain", gain);
  time_of("a patch at a random gain", std::nullopt);
}

#ifdef MALUS_WITH_CUDA
void add_device_lines(SynthesisBenchmark& bench, const CompiledNoise& noise, double top_dn) {
  if (!cuda::device_available()) return;
  const int side = bench.context.quick ? 512 : 16384;
  const cuda::DeviceRates rates = cuda::measure_rates(noise, side, side, top_dn);
  bench.lines.push_back({"physics, GPU", 1e-6 * rates.drawn, "Mpx/s", cuda::device_name()});
  bench.lines.push_back({"copy on the GPU", 1e-6 * rates.copied, "Mpx/s", ""});
  bench.lines.push_back(
      {"physics as a share of copying, GPU", 100 * rates.drawn / rates.copied, "%", ""});
}
#endif

std::vector<BenchmarkLine> synthesis_lines(const BenchmarkContext& context) {
  const int rows = context.quick ? 64 : kRows;
  SynthesisBenchmark bench{context, rows, rows * 1e-6 * kCols, {}};
  const NoiseModel model = load_model("builtin:imx250myr-simulated");
  const GainSetting gain{.gain_db = 12.0, .iso = {}};
  const PhysicsNoise noise = model.physics_at(gain);
  const double top = white_above_black(model.white_dn, model.black_dn);
  const Image clean = spread_signals(rows, kCols, top);
  const Image dim = spread_signals(rows, kCols, 20.0 * noise.channels[0].gain_dn_per_e);
  Image noisy(rows, kCols);
  DrawAddress address{.seed = 1};
  const std::string size = fmt::format("{} x {} float -> float, 16 channels", kCols, rows);

  const double copied = bench.rate(
      "copy", [&] { copy(clean, noisy); }, size);
  const CompiledNoise compiled(noise);
  const double drawn = bench.rate(
      "physics, " + counted(thread_count(), "thread"),
      [&] { compiled.apply(clean.view(), noisy.view(), address); },
      fmt::format("0 to saturation, {}", internal::kernel_target()));
  bench.lines.push_back({"physics as a share of copying", 100 * drawn / copied, "%",
                         "bound by arithmetic: two random words, two table look-ups per pixel"});
  bench.rate("physics, 0 to 20 electrons",
             [&] { compiled.apply(dim.view(), noisy.view(), address); });
  Plane<std::uint16_t> raw(rows, kCols);
  const CameraOutput camera{model.black_dn, model.white_dn, 1.0};
  bench.rate("physics, float -> uint16 raw",
             [&] { compiled.apply(clean.view(), raw.view(), address, camera); });
  bench.rate("physics, uint16 raw -> uint16 raw",
             [&] { compiled.apply(raw.view(), raw.view(), address, camera); });
  const CompiledNoise gaussian = CompiledNoise::gaussian(
      noise.layout,
      std::vector<GaussianChannel>(
          16, {.slope_dn = 0.4, .offset_dn2 = 4, .sigma_row_dn = 0, .mu_dn = 0}),
      1);
  bench.rate("heteroscedastic Gaussian",
             [&] { gaussian.apply(clean.view(), noisy.view(), address); });
  const LevelSampler sampler(noise.layout, levels_of(noise.layout.channels()), 2);
  bench.rate(
      "non-parametric, 256 levels x 128 bins",
      [&] { sampler.apply(clean.view(), noisy.view(), address); }, "", 5);
  bench.rate(
      "physics, plain definition (--exact)",
      [&] { add_noise_exact(noise, clean.view(), noisy.view(), address); }, "", 1);
  const double compile_s = context.time_s([&] { const CompiledNoise again(noise); }, 5);
  bench.lines.push_back({"compiling 16 channels", 1e3 * compile_s, "ms", "per set of parameters"});
  add_patch_lines(bench, model, gain);
#ifdef MALUS_WITH_CUDA
  add_device_lines(bench, compiled, top);
#endif
  return bench.lines;
}

}  // namespace

Benchmark benchmark_synthesize() { return {"synthesize", synthesis_lines}; }

}  // namespace malus::app
