#include "malus/neural/training_config.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/io/config_section.h"
#include "malus/io/shard.h"
#include "malus/neural/internal/contents.h"
#include "malus/neural/internal/json_text.h"
#include "malus/neural/internal/refresh.h"
#include "malus/neural/named_networks.h"
#include "malus/neural/noise_flow_file.h"
#include "malus/noise/model.h"
#include "malus/synthesize/light_case.h"
#include "malus/synthesize/scene.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

template <class Settings>
std::vector<std::string> names_of() {
  const Settings settings;
  std::vector<std::string> names;
  Settings::describe(settings,
                     [&](const auto&, const ParameterInfo& info) { names.push_back(info.name); });
  return names;
}

template <class Settings>
Json json_of(const Settings& settings) {
  Json json;
  Settings::describe(
      settings, [&](const auto& value, const ParameterInfo& info) { json[info.name] = value; });
  return json;
}

// Files (or folders) of patterns relative to the configuration.
std::vector<fs::path> matches(const ConfigSection& section, const char* key,
                              const fs::path& folder) {
  std::vector<fs::path> all;
  for (const std::string& pattern : section.texts(key)) {
    if (fs::is_directory(folder / pattern)) {
      all.push_back(folder / pattern);
      continue;
    }
    const auto found = files_matching(folder, pattern);
    if (found.empty())
      section.fail(key, fmt::format("\"{}\" matches no file", pattern), "check the pattern");
    all.insert(all.end(), found.begin(), found.end());
  }
  return all;
}

NamedNetwork named_architecture(const ConfigSection& section) {
  if (!section.has("architecture"))
    section.fail("architecture", "is missing", "name one, e.g. \"unet\"");
  const NamedNetwork named = network_of_name(*section.text("architecture"));
  std::vector<std::string> names = network_names();
  if (std::find(names.begin(), names.end(), named.architecture) == names.end()) {
    for (const NamedNetwork& size : named_networks())
      if (size.name != size.architecture) names.push_back(size.name);
    names.push_back(kNoiseFlowArchitecture);  // whose configurations are read elsewhere
    section.fail("architecture", fmt::format("is \"{}\"", named.name),
                 did_you_mean(named.name, names, true) + "known: " + joined(names));
  }
  return named;
}

// The network's own settings are those of its architecture, by the kinds of their defaults.
NetworkDescription read_network(const ConfigSection& section) {
  const NamedNetwork named = named_architecture(section);
  NetworkDescription network{named.architecture, named.settings};
  const Json defaults = default_network_settings(network.architecture);
  std::vector<std::string> known{"architecture"};
  for (const auto& [key, value] : defaults.items()) known.push_back(key);
  section.require_known(known);
  for (const auto& [key, value] : defaults.items()) {
    if (!section.has(key)) continue;
    if (value.is_boolean())
      network.settings[key] = *section.flag(key);
    else if (value.is_string())
      network.settings[key] = *section.text(key);
    else if (value.is_number_integer())
      network.settings[key] = *section.whole_number(key, 0, 1 << 20);
    else if (value.is_number())
      network.settings[key] = *section.number(key);
    else {
      std::vector<int> list;
      for (const double number : section.numbers(key)) {
        if (!(number >= 0 && number <= 1 << 20) || number != std::floor(number))
          section.fail(key, fmt::format("holds {:g}", number), "give whole numbers");
        list.push_back(static_cast<int>(number));
      }
      network.settings[key] = list;
    }
  }
  return network;
}

void read_models(const ConfigSection& section, const fs::path& folder, TrainingConfig& config) {
  if (!config.models.empty()) return;
  for (const std::string& name : section.texts("models")) {
    const fs::path beside = folder / name;
    config.models.push_back(fs::exists(beside) ? beside : fs::path(name));
    // Files say themselves what is wrong with them, a name does not say where it is written.
    if (!fs::exists(config.models.back()))
      section.naming("models", [&] { return load_model(config.models.back()); });
  }
  if (config.models.empty()) section.fail("models", "is missing", "name one or more noise models");
}

void read_noise(const ConfigSection& section, const fs::path& folder, TrainingConfig& config) {
  auto also = names_of<TrainingNoiseSettings>();
  also.push_back("models");
  section.read(config.synthesis, also);
  also = names_of<SynthesisSettings>();
  also.push_back("models");
  section.read(config.noise, also);
  for (const char* key : {"ratio", "debias", "amplify"})
    if (section.has(key))
      section.fail(key, "has no meaning here",
                   "give ratio_low and ratio_high; bias and amplification belong to [package]");
  if (config.noise.ratio_low > config.noise.ratio_high)
    section.fail("ratio_low", "is above ratio_high", "exchange them");
  read_models(section, folder, config);
  // The usual kind, too, which the settings no longer tell from none.
  if (section.has("kind") && std::ranges::all_of(config.models, names_noise_flow))
    section.fail("kind", "means nothing to the noise of a Noise Flow",
                 "leave it out, or name a calibrated model");
}

void read_validation(const ConfigSection& section, const fs::path& folder, TrainingConfig& config) {
  section.read(config.validation, {"scenes", "cases"});
  config.validation_scenes = matches(section, "scenes", folder);
  for (const std::string& text : section.texts("cases")) {
    const auto light = parsed_light_case(text);
    if (!light)
      section.fail("cases", fmt::format("\"{}\" is not GAIN:RATIO", text), "e.g. \"12:60\"");
    config.cases.push_back(*light);
  }
  if (config.validation_scenes.empty())
    section.fail("scenes", "is missing", "name scenes, or leave [validation] out");
  if (config.cases.empty()) section.fail("cases", "is missing", "e.g. [\"12:10\", \"12:60\"]");
}

// What the noise of shards and captured pairs, and their light, does not follow. Frames of a
// validation are drawn with the settings of the noise itself. A file may serve pictures, too: what
// is set for this run alone (settings, "SECTION.KEY=VALUE") expects something.
void refuse_settings_of_pictures(const ConfigSection& data, const ConfigSection& noise,
                                 const std::vector<std::string>& settings,
                                 const TrainingConfig& config) {
  if (!config.pictures.empty() || !config.scenes.empty()) return;
  const auto refuse = [&](const ConfigSection& section, const char* name,
                          const std::vector<std::string>& keys, const char* remedy) {
    for (const std::string& key : keys)
      for (const std::string& given : settings)
        if (given.starts_with(fmt::format("{}.{}=", name, key)) && key != "extrapolate_gain")
          section.fail(key, "means nothing to shards and captured pairs, which have their own",
                       remedy);
  };
  const char* of_noise = "leave it out; that of shards is set by the [noise] of malus dataset";
  const char* of_light = "leave it out, or name pictures or scenes";
  refuse(noise, "noise", names_of<TrainingNoiseSettings>(), of_noise);
  refuse(data, "data", {"exposure_low", "exposure_high", "zoom", "symmetries"}, of_light);
  if (!config.validation_scenes.empty()) return;
  refuse(noise, "noise", names_of<SynthesisSettings>(), of_noise);
  refuse(data, "data", {"polarized", "tone"}, of_light);
}

// The key that what is wrong with a network's settings names, of those that are written there.
std::string key_in(const ConfigSection& network, const InputError& error) {
  for (const std::string& key : network.keys())
    if (error.problem().find(fmt::format("\"{}\"", key)) != std::string::npos) return key;
  return "architecture";
}

void require_possible(const ConfigSection& section, const NetworkDescription& network) {
  try {
    full_settings(network);
  } catch (const InputError& error) {
    section.fail(key_in(section, error), error);
  }
}

void check_sizes(const ConfigSection& root, const TrainingConfig& config) {
  const ConfigSection data = *root.section("data");
  const SensorLayout layout = config.package.layout();
  const int cell = std::lcm(std::lcm(layout.rows(), layout.cols()), 2);
  for (const auto& [name, size] :
       {std::pair{"patch", config.data.patch}, std::pair{"example", config.data.example}})
    if (size % cell != 0)
      data.fail(name, fmt::format("= {} is not made of whole cells and row groups", size),
                fmt::format("use a multiple of {}", cell));
  if (config.data.patch > config.data.example)
    data.fail(
        "patch",
        fmt::format("= {} is larger than example = {}", config.data.patch, config.data.example),
        "make example as large, or patch smaller");
  if (config.train.loss != "l1" && !layout.polarized())
    root.section("train")->fail(
        "loss", fmt::format("= \"{}\" needs polarizer angles", config.train.loss), "use \"l1\"");
  if (config.package.network.settings.value("upscale", 1) != config.package.upscale())
    root.section("network")->fail(
        "upscale", fmt::format("does not fit target = \"{}\"", config.package.settings.target),
        "leave it out");
  if (config.pictures.empty() && config.scenes.empty() && config.shards.empty() &&
      config.pairs.empty())
    root.fail("data", "names no pictures, scenes, shards or pairs", "give one of them");
  const double planes = config.package.output_planes() * std::pow(config.package.upscale(), 2) +
                        config.package.input_planes();
  // As many as a pool holds at once (example_pool.h).
  const int generations = config.data.pool + kGenerationsAhead;
  const double bytes = 4.0 * planes * config.data.example * config.data.example /
                       layout.channels() * generations * config.train.batch;
  if (bytes > config.data.memory_mib * 0x1p20)
    data.fail("pool", fmt::format("would take up to {:.0f} MiB", std::ceil(bytes / 0x1p20)),
              fmt::format("allow it with memory, or make pool, batch or example smaller"));
}

Json json_of(const std::vector<fs::path>& paths) {
  Json json = Json::array();
  for (const fs::path& path : paths) json.push_back(json_text(path.filename().string()));
  return json;
}

}  // namespace

TrainingConfig load_training_config(const fs::path& path, const TrainingOverrides& overrides) {
  const ConfigSection root =
      ConfigSection::load(path, "the training configuration", overrides.settings);
  // First: which tables there are follows from it.
  if (const auto section = root.section("network")) named_architecture(*section);
  root.require_known({"network", "package", "data", "noise", "train", "validation"});
  const fs::path folder = path.parent_path();
  TrainingConfig config;
  config.source = path;
  const auto network = root.section("network"), data = root.section("data"),
             noise = root.section("noise");
  if (!network) root.fail("network", "is missing", "add a [network] table");
  if (!data) root.fail("data", "is missing", "add a [data] table");
  if (!noise) root.fail("noise", "is missing", "add a [noise] table");
  const NetworkDescription described = read_network(*network);
  const auto fit = [&] { return fitted_network(described, config.package.settings); };
  if (const auto section = root.section("package")) {
    section->read(config.package.settings);
    section->naming("layout", [&] { return config.package.layout(); });
    if (config.package.settings.domain == "stabilised" &&
        config.package.settings.amplification == "ratio")
      section->fail("amplification", "means nothing in the stabilised domain",
                    "leave it out, or set domain = \"linear\"");
    config.package.network = section->naming("target", fit);
  } else {
    config.package.network = fit();
  }
  require_possible(*network, config.package.network);
  data->read(config.data, {"pictures", "scenes", "shards", "pairs", "tone"});
  if (config.data.exposure_low > config.data.exposure_high)
    data->fail("exposure_low", "is above exposure_high", "exchange them");
  config.pairs = overrides.pairs;
  if (config.pairs.empty()) {
    config.pictures = matches(*data, "pictures", folder);
    config.scenes = matches(*data, "scenes", folder);
    config.shards = matches(*data, "shards", folder);
    config.pairs = matches(*data, "pairs", folder);
  }
  config.tone = data->text("tone").value_or("auto");
  const std::vector<std::string>& tones = picture_tones();
  if (std::find(tones.begin(), tones.end(), config.tone) == tones.end())
    data->fail("tone", fmt::format("\"{}\" is not known", config.tone),
               did_you_mean(config.tone, tones, true) + "known: " + joined(tones));
  config.models = overrides.models;
  read_noise(*noise, folder, config);
  // The Stokes part of the loss needs polarizer angles.
  if (!config.package.layout().polarized()) config.train.loss = "l1";
  if (const auto section = root.section("train")) {
    section->read(config.train, {"begin_with"});
    if (const auto weights = section->text("begin_with")) config.begin_with = folder / *weights;
  }
  if (const auto section = root.section("validation")) read_validation(*section, folder, config);
  // Who puts pairs in place of pictures has a configuration of pictures.
  if (overrides.pairs.empty())
    refuse_settings_of_pictures(*data, *noise, overrides.settings, config);
  check_sizes(root, config);
  return config;
}

Json config_json(const TrainingConfig& config) {
  Json cases = Json::array();
  for (const LightCase& one : config.cases)
    cases.push_back(fmt::format("{:g}:{:g}", one.gain, one.ratio));
  Json noise = json_of(config.noise);
  noise.update(json_of(config.synthesis));
  noise["models"] = json_of(config.models);
  Json json{{"network",
             {{"architecture", config.package.network.architecture},
              {"settings", config.package.network.settings}}},
            {"package", json_of(config.package.settings)},
            {"data", json_of(config.data)},
            {"pictures", json_of(config.pictures)},
            {"scenes", json_of(config.scenes)},
            {"shards", json_of(config.shards)},
            {"pairs", json_of(config.pairs)},
            {"tone", config.tone},
            {"noise", noise},
            {"train", json_of(config.train)},
            {"validation", json_of(config.validation)},
            {"validation_scenes", json_of(config.validation_scenes)},
            {"cases", cases}};
  if (!config.begin_with.empty())
    json["begin_with"] = json_text(config.begin_with.filename().string());
  json["contents"] = contents_json(config);
  return json;
}

}  // namespace malus
