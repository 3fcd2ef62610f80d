#include "malus/base/error.h"
#include "malus/image/quantization.h"
#include "malus/io/config_section.h"
#include "malus/io/frame_file.h"
#include "malus/io/shard.h"
#include "malus/neural/noise_flow_training.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

ConfigSection root_of(const std::filesystem::path& config,
                      const std::vector<std::string>& settings) {
  return ConfigSection::load(config, "the training configuration", settings);
}

NoiseFlowSensor read_sensor(const ConfigSection& section) {
  section.require_known({"layout", "black", "white"});
  NoiseFlowSensor sensor;
  const auto layout = section.text("layout");
  if (!layout) section.fail("layout", "is missing", "name the sensor's layout");
  const auto channels = section.naming(
      "layout", [&] { return static_cast<std::size_t>(SensorLayout::named(*layout).channels()); });
  sensor.layout = *layout;
  sensor.black_dn = section.numbers("black");
  if (sensor.black_dn.size() == 1) sensor.black_dn.assign(channels, sensor.black_dn.front());
  if (sensor.black_dn.size() != channels)
    section.fail("black", "is missing or of another length", "give one number, or one per channel");
  const auto white = section.number("white");
  if (!white || !(white_above_black(*white, sensor.black_dn) > 0))
    section.fail("white", "is missing or not above black", "give the saturation in DN");
  sensor.white_dn = *white;
  return sensor;
}

// 0 of fractional pixels. Whole numbers that are all equal tell no step: 1, which divides any.
double step_of(const Image& dn) {
  if (const double step = quantization_step(dn); step > 0) return step;
  const bool whole = std::all_of(dn.values().begin(), dn.values().end(),
                                 [](float value) { return value == std::round(value); });
  return whole ? 1.0 : 0.0;
}

std::vector<NoiseFlowPair> read_pairs(const ConfigSection& section, const NoiseFlowSensor& sensor) {
  section.require_known({"noisy", "clean", "gain_db", "iso"});
  FrameOptions options;
  options.layout = SensorLayout::named(sensor.layout);
  options.black_dn = sensor.black_dn;
  options.white_dn = sensor.white_dn;
  const GainSetting gain{section.number("gain_db"), section.number("iso")};
  const auto folder = std::filesystem::path(section.source()).parent_path();
  const auto load = [&](const std::filesystem::path& path) { return load_frame(path, options); };
  const auto above_black = [](RawFrame frame) {
    // Float files hold DN above black already.
    if (frame.bits > 0) subtract_black(frame);
    return std::move(frame.dn);
  };
  const auto clean_name = section.text("clean");
  if (!clean_name) section.fail("clean", "is missing", "give the clean frame");
  const Image clean_dn = above_black(load(folder / *clean_name));
  std::vector<NoiseFlowPair> pairs;
  for (const std::string& pattern : section.texts("noisy")) {
    const auto found = files_matching(folder, pattern);
    if (found.empty())
      section.fail("noisy", fmt::format("\"{}\" matches no file", pattern), "check the pattern");
    for (const auto& path : found) {
      RawFrame noisy = load(path);
      const GainSetting of_pair = gain.decibel() ? gain : noisy.gain;
      const double step_dn = step_of(noisy.dn);  // black need not be whole
      pairs.push_back({above_black(std::move(noisy)), clean_dn, of_pair, path.string(), step_dn});
    }
  }
  if (pairs.empty()) section.fail("noisy", "names no frame", "give files or patterns");
  return pairs;
}

}  // namespace

bool is_noise_flow_config(const std::filesystem::path& config,
                          const std::vector<std::string>& settings) {
  const auto network = root_of(config, settings).section("network");
  return network && network->text("architecture") == kNoiseFlowArchitecture;
}

NoiseFlowFit train_noise_flow_config(const std::filesystem::path& config,
                                     const std::vector<std::string>& settings, std::uint64_t seed,
                                     Progress& progress) {
  const ConfigSection root = root_of(config, settings);
  root.require_known({"network", "sensor", "pairs", "train"});
  root.section("network")->require_known({"architecture"});
  const auto sensor_section = root.section("sensor");
  if (!sensor_section) root.fail("sensor", "is missing", "add a [sensor] table");
  const NoiseFlowSensor sensor = read_sensor(*sensor_section);
  NoiseFlowSettings training;
  if (const auto train = root.section("train")) train->read(training);
  std::vector<NoiseFlowPair> pairs;
  if (!root.has("pairs"))
    root.fail("pairs", "is missing", "add a [[pairs]] table with noisy and clean frames");
  for (const ConfigSection& section : root.sections("pairs"))
    for (NoiseFlowPair& pair : read_pairs(section, sensor)) pairs.push_back(std::move(pair));
  return train_noise_flow(sensor, pairs, training, seed, progress);
}

}  // namespace malus
