#include "malus/base/error.h"
#include "malus/image/frame_statistics.h"
#include "malus/image/quantization.h"
#include "malus/io/config_section.h"
#include "malus/io/frame_file.h"
#include "malus/io/pair_list.h"
#include "malus/io/shard.h"
#include "malus/neural/internal/contents.h"
#include "malus/neural/noise_flow_training.h"
#include "malus/noise/model.h"
#include "malus/synthesize/pairs.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

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

NoiseFlowSensor sensor_of(const NoiseModel& model) {
  NoiseFlowSensor sensor;
  sensor.layout = model.layout.name();
  sensor.black_dn = model.black_dn;
  sensor.white_dn = model.white_dn;
  return sensor;
}

std::vector<NoiseFlowFiles> read_pairs(const ConfigSection& section) {
  section.require_known({"noisy", "clean", "gain_db", "iso"});
  const GainSetting gain{section.number("gain_db"), section.number("iso")};
  if (gain.gain_db && gain.iso)
    section.fail("iso", "is given beside gain_db", "give the gain in one unit");
  const auto folder = fs::path(section.source()).parent_path();
  const auto clean_name = section.text("clean");
  if (!clean_name) section.fail("clean", "is missing", "give the clean frame");
  if (!fs::exists(frame_place(folder / *clean_name).file))
    section.fail("clean", fmt::format("\"{}\" does not exist", *clean_name), "check the name");
  std::vector<NoiseFlowFiles> pairs;
  for (const std::string& pattern : section.texts("noisy")) {
    const auto found = files_matching(folder, pattern);
    if (found.empty())
      section.fail("noisy", fmt::format("\"{}\" matches no file", pattern), "check the pattern");
    for (const auto& path : found)
      for (const auto& frame : frame_names(path))
        pairs.push_back({frame, folder / *clean_name, gain});
  }
  if (pairs.empty()) section.fail("noisy", "names no frame", "give files or patterns");
  return pairs;
}

std::vector<NoiseFlowFiles> captured_pairs(const std::vector<fs::path>& lists) {
  std::vector<NoiseFlowFiles> pairs;
  for (const fs::path& list : lists) {
    const std::vector<RecordedPair> recorded = load_pair_list(list);
    if (recorded.empty())
      throw InputError(list.string(), "holds no pairs", "make some with malus pairs");
    for (const RecordedPair& pair : recorded)
      pairs.push_back({pair.noisy, pair.reference, pair.gain, pair.ratio, pair.bias_at});
  }
  return pairs;
}

// DN above black of frames as the sensor took them; float files hold that already.
class PairFrames {
 public:
  explicit PairFrames(const NoiseFlowConfig& config) {
    options_.layout = SensorLayout::named(config.sensor.layout);
    options_.black_dn = config.sensor.black_dn;
    options_.white_dn = config.sensor.white_dn;
    white_dn_ = white_above_black(config.sensor.white_dn, config.sensor.black_dn);
    if (config.model.empty()) return;
    model_ = load_model(config.model);
    if (!model_->defects.empty() && !model_->physics.empty())  // the same at every gain
      defects_ = model_->profile_at(model_->physics.front().gain).defects;
  }

  NoiseFlowPair load(const NoiseFlowFiles& files) {
    RawFrame noisy = load_frame(files.noisy, options_);
    const GainSetting gain = files.gain.decibel() ? files.gain : noisy.gain;
    require_white(noisy);
    const double step_dn = step_of(noisy.dn);  // black need not be whole
    NoiseFlowPair pair{above_black(std::move(noisy)), clean_of(files), gain, files.noisy.string(),
                       step_dn};
    mark_unknown(pair.noisy_dn, white_dn_);
    return pair;
  }

 private:
  static void require_white(const RawFrame& noisy) {
    if (noisy.bits == 0) return;  // floats of the light, which a simulation may not have clipped
    const double beyond = share_beyond_white(noisy);
    if (beyond == 0) return;  // a few hot pixels may be: none at white is learnt from
    throw InputError(noisy.source,
                     fmt::format("{:.3g} % of its pixels lie above the white of {:g} DN",
                                 100 * beyond, noisy.white_dn),
                     "give the sensor's white");
  }
  static Image above_black(RawFrame frame) {
    if (frame.bits > 0) subtract_black(frame);
    return std::move(frame.dn);
  }

  // Of integers the sensor's; of floats, which have a black and a light of their own, what their
  // file tells, if anything.
  double white_of(const RawFrame& reference, const fs::path& path) const {
    if (reference.bits > 0) return white_dn_;
    FrameOptions options;
    options.layout = options_.layout;
    return white_of_reference(probe_frame(path, options).frame, white_dn_);
  }

  // Several noisy frames in a row may share it.
  const Image& clean_of(const NoiseFlowFiles& files) {
    if (files.clean == clean_.clean && files.ratio == clean_.ratio &&
        files.bias_at == clean_.bias_at && !clean_dn_.empty())
      return clean_dn_;
    clean_ = files;
    RawFrame reference = load_frame(files.clean, options_);
    const double white_dn = white_of(reference, files.clean);
    Image reference_dn = above_black(std::move(reference));
    mark_unknown(reference_dn, white_dn, defects_);
    clean_dn_ = light_of_reference(std::move(reference_dn), files.ratio,
                                   model_ ? &*model_ : nullptr, files.bias_at);
    return clean_dn_;
  }

  FrameOptions options_;
  double white_dn_;
  std::optional<NoiseModel> model_;
  DefectList defects_;
  NoiseFlowFiles clean_;
  Image clean_dn_;
};

}  // namespace

bool is_noise_flow_config(const fs::path& config, const std::vector<std::string>& settings) {
  const auto network = root_of(config, settings).section("network");
  return network && network->text("architecture") == kNoiseFlowArchitecture;
}

NoiseFlowConfig load_noise_flow_config(const fs::path& path, const TrainingOverrides& overrides) {
  const ConfigSection root = root_of(path, overrides.settings);
  root.require_known({"network", "sensor", "pairs", "train"});
  root.section("network")->require_known({"architecture"});
  NoiseFlowConfig config;
  config.source = path;
  if (!overrides.models.empty()) {
    config.model = overrides.models.front();
    config.sensor = sensor_of(load_model(config.model));
  } else {
    const auto section = root.section("sensor");
    if (!section) root.fail("sensor", "is missing", "add a [sensor] table");
    config.sensor = read_sensor(*section);
  }
  if (const auto train = root.section("train")) train->read(config.settings);
  if (!overrides.pairs.empty()) {
    config.pairs = captured_pairs(overrides.pairs);
    return config;
  }
  if (!root.has("pairs"))
    root.fail("pairs", "is missing", "add a [[pairs]] table with noisy and clean frames");
  for (const ConfigSection& section : root.sections("pairs"))
    for (NoiseFlowFiles& pair : read_pairs(section)) config.pairs.push_back(std::move(pair));
  return config;
}

nlohmann::json config_json(const NoiseFlowConfig& config) {
  nlohmann::json train, pairs = nlohmann::json::array();
  NoiseFlowSettings::describe(config.settings, [&](const auto& value, const ParameterInfo& info) {
    train[info.name] = value;
  });
  std::vector<fs::path> files;
  for (const NoiseFlowFiles& pair : config.pairs) {
    pairs.push_back({pair.gain.text(), pair.ratio, pair.bias_at ? pair.bias_at->text() : ""});
    files.insert(files.end(), {pair.noisy, pair.clean});
  }
  nlohmann::json contents{{"pairs", contents_of(files)}};
  // Whose bias the clean frames lose.
  if (fs::is_regular_file(config.model)) contents["models"] = contents_of_model(config.model);
  return {{"network", {{"architecture", kNoiseFlowArchitecture}}},
          {"sensor",
           {{"layout", config.sensor.layout},
            {"black", config.sensor.black_dn},
            {"white", config.sensor.white_dn}}},
          {"train", train},
          {"pairs", pairs},
          {"contents", contents}};
}

NoiseFlowFit train_noise_flow(const NoiseFlowConfig& config, std::uint64_t seed,
                              Progress& progress) {
  PairFrames frames(config);
  std::vector<NoiseFlowPair> pairs;
  for (const NoiseFlowFiles& files : config.pairs) pairs.push_back(frames.load(files));
  return train_noise_flow(config.sensor, pairs, config.settings, seed, progress);
}

}  // namespace malus
