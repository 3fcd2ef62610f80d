// Noise for a training batch, 16 packed planes of 512 x 512, into existing memory: the numbers that
// the Python module and PyTorch are compared with (bench/peers/packed_*.py).
#include "malus/base/parallel.h"
#include "malus/base/random.h"
#include "malus/base/text.h"
#include "malus/synthesize/model.h"

#include "benchmarks.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

constexpr int kPlanes = 16, kSide = 512, kRepetitions = 25;
constexpr double kGainDb = 12, kTopDn = 4000;

std::vector<BenchmarkLine> packed_lines(const BenchmarkContext& context) {
  const int rows = context.quick ? 16 : kSide;
  const auto noise = Model::load("imx250myr-simulated").at_gain(kGainDb);
  Planes clean(kPlanes, rows, kSide), noisy(kPlanes, rows, kSide);
  std::vector<View<const float>> from;
  std::vector<View<float>> to;
  for (int k = 0; k < kPlanes; ++k) {
    RandomSequence random(0, 0, Draw::kParameters, static_cast<std::uint64_t>(k));
    for (float& v : clean[k].values()) v = static_cast<float>(kTopDn * random.uniform());
    from.push_back(clean[k].view());
    to.push_back(noisy[k].view());
  }
  std::uint32_t frame = 0;
  const double seconds =
      context.time_s([&] { noise.synthesize_packed(from, to, /*seed=*/1, frame++); }, kRepetitions);
  const double pixels = static_cast<double>(kPlanes) * rows * kSide;
  return {{"C++ library", pixels / seconds * 1e-6, "Mpx/s",
           fmt::format("16 x {} x {} into existing memory, {}", rows, kSide,
                       counted(thread_count(), "thread"))}};
}

}  // namespace

Benchmark benchmark_packed() { return {"packed", packed_lines}; }

}  // namespace malus::app
