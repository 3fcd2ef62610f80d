// malus bench networks: parameters, multiplications and time of every network; the figures of
// docs/networks.md.
#include "benchmarks.h"
#include "networks_door.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

constexpr int kChannels = 16, kCountedSide = 128, kTimedSide = 256, kQuickSide = 16;

std::vector<BenchmarkLine> run(const BenchmarkContext& context) {
  std::vector<BenchmarkLine> lines;
  if (!have_networks()) return lines;
  const NetworkFunctions& functions = networks();
  const int counted_side = context.quick ? kQuickSide : kCountedSide,
            side = context.quick ? kQuickSide : kTimedSide;
  for (const NamedNetwork& network : functions.named_networks()) {
    const NetworkCost size = functions.measure(network, kChannels, counted_side, counted_side, 0);
    lines.push_back(
        {network.name + ", parameters", static_cast<double>(size.parameters) / 1e6, "M", ""});
    lines.push_back({network.name + ", multiply-adds", size.multiply_adds / 1e9, "G",
                     fmt::format("{} x {} x {}", kChannels, counted_side, counted_side)});
    const NetworkCost time =
        functions.measure(network, kChannels, side, side, context.quick ? 1 : 3);
    lines.push_back({network.name + ", forward", time.seconds, "s",
                     fmt::format("float32, {} x {} x {}", kChannels, side, side)});
  }
  return lines;
}

}  // namespace

Benchmark benchmark_networks() { return {"networks", run}; }

}  // namespace malus::app
