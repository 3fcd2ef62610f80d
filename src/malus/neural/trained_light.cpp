#include "malus/neural/internal/trained_light.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/neural/internal/example_pool.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr std::uint32_t kExamples = 128;
constexpr double kQuantile = 0.999;  // single highlights teach nothing
constexpr double kFade = 0.2;        // of the brightest light, to both sides

}  // namespace

torch::Tensor signal_in_deviations(const NetworkPackage& package, const torch::Tensor& input) {
  MALUS_REQUIRE(package.settings.noise_input != "none");
  const torch::Tensor base = input.slice(1, 0, package.planes());
  return (base / noise_level_of(package, input)).mean(1, true);
}

double brightest_light(const NetworkPackage& package, const PairSource& source, std::uint64_t seed,
                       Progress& progress) {
  if (package.settings.noise_input == "none") return std::numeric_limits<double>::infinity();
  const torch::NoGradGuard no_gradients;
  NetworkPackage without_guide = package;  // which would take nearly all of the time
  without_guide.settings.guide = "none";
  std::vector<torch::Tensor> signals(kExamples);
  const auto measure = [&](std::ptrdiff_t i) {
    const auto number = static_cast<std::uint32_t>(i);
    const TrainingExample example = make_example(source.pair(seed, number), without_guide);
    signals[number] = signal_in_deviations(without_guide, example.input.unsqueeze(0)).flatten();
  };
  measure(0);  // data that are no good mostly show it here, and then nothing else is said
  progress.note(
      fmt::format("the light of {} examples is measured before the first step", kExamples));
  progress.begin("light of the examples", kExamples);
  progress.advance(1);
  parallel_for(1, kExamples, 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    // Examples hold locks while they load pictures: a thread that waits there may not take up
    // another example.
    const SerialLoops alone;
    const torch::NoGradGuard no_gradients_here;
    for (std::ptrdiff_t i = begin; i < end; ++i) {
      check_stop(progress);
      measure(i);
      progress.advance(1);
    }
  });
  const torch::Tensor sorted = std::get<0>(torch::cat(signals).sort());
  const auto last = static_cast<double>(sorted.numel() - 1);
  const auto brightest = sorted[static_cast<std::int64_t>(kQuantile * last)].item<double>();
  return std::max(brightest, 1.0);
}

torch::Tensor share_of_correction(const NetworkPackage& package, const torch::Tensor& input) {
  const torch::Tensor times = signal_in_deviations(package, input) / package.brightest;
  return (0.5 + (1 - times) / (2 * kFade)).clamp(0, 1);
}

std::int64_t count_brighter(const NetworkPackage& package, const torch::Tensor& input) {
  if (!std::isfinite(package.brightest)) return 0;
  return (signal_in_deviations(package, input) > package.brightest).sum().item<std::int64_t>();
}

}  // namespace malus
