// malus bench networks: parameters, multiplications and time of every network; the figures of
// docs/networks.md; on a GPU images per second.
#include "malus/base/error.h"
#include "malus/base/text.h"

#include <algorithm>

#include "benchmarks.h"
#include "networks_door.h"
#include <CLI/CLI.hpp>
#include <fmt/format.h>

namespace malus::app {
namespace {

constexpr int kNetworkChannels = 16, kCountedSide = 128, kTimedSide = 256, kQuickSide = 16;
// The network that is timed on a whole frame of 2448 x 2048, packed.
constexpr const char* kFrameNetwork = "malus-small";
constexpr int kFrameRows = 512, kFrameCols = 612;

BenchmarkLine time_line(const std::string& name, const NetworkCost::Time& time,
                        const std::string& note) {
  return {name, time.seconds, "s",
          fmt::format("{}; {:.3f} s of processor time", note, time.processor_seconds)};
}

std::string rounding_of(const DeviceSpeed& speed) {
  if (speed.tf32_convolutions && speed.tf32_products) return ", TF32";
  return speed.tf32_convolutions ? ", TF32 in convolutions" : "";
}

void check_names(const std::vector<std::string>& wanted) {
  std::vector<std::string> known;
  for (const NamedNetwork& network : networks().named_networks()) known.push_back(network.name);
  for (const std::string& name : wanted)
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw CLI::ValidationError(
          "--network", fmt::format("\"{}\" is no network of this benchmark; {}known: {}", name,
                                   did_you_mean(name, known), joined(known)));
}

std::vector<BenchmarkLine> device_lines(const BenchmarkContext& context) {
  DeviceWork work{.device = context.device, .channels = kNetworkChannels, .once = context.quick};
  if (context.quick) {
    work.inference_batch = work.training_batch = 1;
    work.inference_side = work.training_side = kQuickSide;
  }
  std::vector<BenchmarkLine> lines;
  for (const NamedNetwork& network : networks().named_networks()) {
    if (!context.wants_network(network.name)) continue;
    for (const DeviceSpeed& speed : networks().measure_device_speed(network, work)) {
      const bool training = speed.work == "training";
      const int side = training ? work.training_side : work.inference_side;
      std::string note =
          fmt::format("{} x {} x {} x {}, channels {} ({:.4g} in the other order)",
                      training ? work.training_batch : work.inference_batch, work.channels, side,
                      side, speed.channels_last ? "last" : "first", speed.other_order_images_per_s);
      if (speed.precision == "float32") note += rounding_of(speed);
      if (speed.images_per_s == 0) note += "; the device's memory does not suffice";
      lines.push_back({fmt::format("{}, {}, {}", network.name, speed.work, speed.precision),
                       speed.images_per_s, "images/s", note});
    }
  }
  return lines;
}

std::vector<BenchmarkLine> network_lines(const BenchmarkContext& context) {
  std::vector<BenchmarkLine> lines;
  if (context.device == "cpu" && !have_networks()) return lines;
  check_names(context.networks);
  if (context.device != "cpu") return device_lines(context);
  const NetworkFunctions& functions = networks();
  const int counted_side = context.quick ? kQuickSide : kCountedSide,
            side = context.quick ? kQuickSide : kTimedSide;
  for (const NamedNetwork& network : functions.named_networks()) {
    if (!context.wants_network(network.name)) continue;
    const NetworkCost size =
        functions.measure(network, kNetworkChannels, counted_side, counted_side, 0);
    lines.push_back(
        {network.name + ", parameters", static_cast<double>(size.parameters) / 1e6, "M", ""});
    lines.push_back({network.name + ", multiply-adds", size.multiply_adds / 1e9, "G",
                     fmt::format("{} x {} x {}", kNetworkChannels, counted_side, counted_side)});
    const NetworkCost time =
        functions.measure(network, kNetworkChannels, side, side, context.quick ? 1 : 3);
    lines.push_back(time_line(network.name + ", forward", time.float32,
                              fmt::format("float32, {} x {} x {}", kNetworkChannels, side, side)));
    if (time.bfloat16)
      lines.push_back(time_line(
          network.name + ", forward, bfloat16", *time.bfloat16,
          fmt::format("differs by {:.1e} of the result's deviation", time.bfloat16_difference)));
    lines.push_back(
        {network.name + ", memory of a pass", time.peak_bytes / 1e6, "MB", "beside the weights"});
    if (network.name != kFrameNetwork || context.quick) continue;
    const NetworkCost frame =
        functions.measure(network, kNetworkChannels, kFrameRows, kFrameCols, 1);
    const std::string note = fmt::format("{} x {} x {}", kNetworkChannels, kFrameRows, kFrameCols);
    lines.push_back({network.name + ", 5-megapixel frame", frame.float32.seconds, "s", note});
    lines.push_back(
        {network.name + ", 5-megapixel frame, memory", frame.peak_bytes / 1e6, "MB", note});
  }
  return lines;
}

}  // namespace

Benchmark benchmark_networks() { return {"networks", network_lines, /*of_networks=*/true}; }

}  // namespace malus::app
