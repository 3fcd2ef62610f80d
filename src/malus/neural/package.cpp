#include "malus/neural/package.h"

#include "malus/base/error.h"
#include "malus/base/settings_check.h"
#include "malus/neural/internal/checkpoint.h"
#include "malus/neural/internal/trained_light.h"
#include "malus/neural/named_source.h"
#include "malus/neural/noise_flow_file.h"
#include "malus/polar/demosaick.h"

#include <cmath>
#include <string_view>

#include <fmt/format.h>

namespace malus {
namespace {

using Json = nlohmann::json;

constexpr const char* kPackageKey = "malus_package";
constexpr const char* kBrightestKey = "brightest";  // absent from files before 2026-11-25
constexpr int kVersion = 1;
constexpr const char* kGivePackage = "give a weight file that malus train or an import wrote";
constexpr double kSeenDeviations = 8;  // brings signals in units of the noise to about 1

// How the architectures call their channel counts.
struct ChannelKeys {
  const char *architecture, *in, *out;
  bool adds_input;  // by its own definition, to its first channels
};
constexpr ChannelKeys kChannelKeys[] = {
    {"unet", "in_channels", "out_channels", false},
    {"nafnet", "img_channel", "img_channel", true},
    {"restormer", "inp_channels", "out_channels", false},
    {"uformer", "in_chans", "dd_in", false},
    {"malus", "in_channels", "out_channels", true},
};

const ChannelKeys& keys_of(const std::string& architecture) {
  for (const ChannelKeys& keys : kChannelKeys)
    if (architecture == keys.architecture) return keys;
  throw InputError(fmt::format("network \"{}\"", architecture),
                   "cannot be used in a package for denoising",
                   "use unet, nafnet, restormer, uformer or malus");
}

// True where the architecture itself returns its input plus a correction.
bool adds_input(const NetworkPackage& package) {
  if (package.network.architecture == "restormer")  // only with as many channels out as in
    return package.input_planes() == package.planes();
  return keys_of(package.network.architecture).adds_input;
}

Json settings_json(const PackageSettings& settings) {
  Json json;
  PackageSettings::describe(
      settings, [&](const auto& value, const ParameterInfo& info) { json[info.name] = value; });
  return json;
}

PackageSettings settings_of(const Json& json, const std::string& source) {
  PackageSettings settings;
  std::size_t known = 0;
  PackageSettings::describe(settings, [&](auto& value, const ParameterInfo& info) {
    if (std::string_view(info.name) == "target" && !json.contains(info.name)) return;
    if (!json.contains(info.name))
      throw InputError(source, fmt::format("its description lacks \"{}\"", info.name),
                       kGivePackage);
    value = json.at(info.name).get<std::decay_t<decltype(value)>>();
    ++known;
    if (const std::string remedy = setting_remedy(value, info); !remedy.empty())
      throw InputError(source, fmt::format("\"{}\" is {}", info.name, json.at(info.name).dump()),
                       remedy);
  });
  if (known != json.size())
    throw InputError(source, "its description has settings that this malus does not know",
                     "use the version of malus that wrote it");
  return settings;
}

void check_picture_settings(const NetworkPackage& package) {
  const PackageSettings& settings = package.settings;
  const auto refuse = [&](const std::string& problem, const char* remedy) {
    throw InputError(fmt::format("target = \"{}\"", settings.target), problem, remedy);
  };
  if (!is_bayer(package.layout()))
    refuse(fmt::format("is for Bayer sensors, the layout is {}", settings.layout),
           "use \"mosaic\", then malus stokes or a developer");
  if (package.network.architecture != "unet")
    refuse(fmt::format("is not offered for {}", package.network.architecture), "use unet");
  if (settings.domain != "linear")
    refuse("needs planes of linear light", "set domain = \"linear\"");
  if (settings.residual)
    refuse("is not the noisy planes plus a correction", "set residual = false");
  if (settings.noise_input == "units")
    refuse("has no plane of noise for each of its planes",
           "set noise_input = \"level\" or \"none\"");
}

}  // namespace

std::optional<CellPhase> PackageSettings::phase_of(const SensorLayout& sensor) const {
  if (gives() != NetworkTarget::kMosaic && !sensor.colored()) return std::nullopt;
  return sensor.phase_in(SensorLayout::named(layout));
}

void check_finite(const TensorFile& file, const std::string& source) {
  for (const auto& [name, stored] : file.tensors)
    if (stored.dtype != "I64" && !torch::isfinite(to_torch(stored)).all().item<bool>())
      throw InputError(source, fmt::format("weight \"{}\" holds values that are not numbers", name),
                       "train again, or take an earlier checkpoint");
}

int NetworkPackage::input_planes() const {
  const int p = planes();
  const int noise = settings.noise_input == "none" ? 0 : settings.domain == "stabilised" ? 1 : p;
  return p + (settings.guide == "none" ? 0 : p) + noise;
}

NetworkDescription fitted_network(NetworkDescription network, const PackageSettings& settings) {
  const ChannelKeys& keys = keys_of(network.architecture);
  const NetworkPackage package{network, settings, {}};
  if (package.gives_picture()) check_picture_settings(package);
  if (network.settings.is_null()) network.settings = Json::object();
  network.settings[keys.out] = package.output_planes();
  network.settings[keys.in] = package.input_planes();
  if (package.gives_picture()) network.settings["upscale"] = package.upscale();
  return network;
}

Json package_json(const NetworkPackage& package) {
  return {{"network",
           {{"architecture", package.network.architecture},
            {"settings", full_settings(package.network)}}},
          {"package", settings_json(package.settings)}};
}

TensorFile package_file(const NetworkPackage& package, const Network& network) {
  TensorFile file = weights_of(network, package.network);
  Json description{{"version", kVersion},
                   {"settings", settings_json(package.settings)},
                   {"channels", package.layout().channel_names()},
                   {"training", package.training}};
  if (std::isfinite(package.brightest)) description[kBrightestKey] = package.brightest;
  file.metadata[kPackageKey] = description.dump();
  return file;
}

namespace {

NetworkPackage described_package(const TensorFile& file, const std::string& source) {
  if (file.metadata.contains(kCheckpointKey))
    throw InputError(source, "is a checkpoint, which a training goes on from",
                     "give weights.safetensors or best.safetensors of its folder");
  const auto text = [&](const char* key) {
    const auto found = file.metadata.find(key);
    if (found == file.metadata.end())
      throw InputError(source, fmt::format("has no \"{}\" in its metadata", key), kGivePackage);
    return found->second;
  };
  if (text("architecture") == kNoiseFlowArchitecture)
    throw InputError(source, "is a Noise Flow: it makes noise, and takes none out",
                     "give it as model to malus synthesize; to denoise, give a network's weights");
  NetworkPackage package;
  package.network = {text("architecture"), Json::parse(text("settings"))};
  const Json description = Json::parse(text(kPackageKey));
  if (description.at("version").get<int>() != kVersion)
    throw InputError(source, fmt::format("is of version {}", description.at("version").dump()),
                     fmt::format("this malus reads version {}", kVersion));
  package.settings = settings_of(description.at("settings"), source);
  package.training = description.at("training");
  package.brightest = description.value(kBrightestKey, package.brightest);
  if (!(package.brightest > 0) ||
      (package.settings.noise_input == "none" && std::isfinite(package.brightest)))
    throw InputError(source, fmt::format("its brightest light, {}, cannot be", package.brightest),
                     kGivePackage);
  if (description.at("channels").get<std::vector<std::string>>() !=
      package.layout().channel_names())
    throw InputError(source,
                     fmt::format("its planes are not in the order of {}", package.settings.layout),
                     kGivePackage);
  const NetworkDescription fitted = fitted_network(package.network, package.settings);
  const ChannelKeys& keys = keys_of(package.network.architecture);
  if (package.network.settings.value("upscale", 1) != package.upscale())
    throw InputError(source,
                     fmt::format("its network's upscale does not fit the target \"{}\"",
                                 package.settings.target),
                     kGivePackage);
  for (const char* key : {keys.in, keys.out})
    if (package.network.settings.value(key, -1) != fitted.settings.at(key).get<int>())
      throw InputError(
          source, fmt::format("its network's {} does not fit {}", key, package.settings.layout),
          fmt::format("{} planes go in and {} come out", package.input_planes(),
                      package.output_planes()));
  return package;
}

}  // namespace

NetworkPackage package_of(const TensorFile& file, const std::string& source) {
  try {
    return naming_source(source, [&] { return described_package(file, source); });
  } catch (const Json::exception& error) {
    throw InputError(source, fmt::format("its description cannot be read ({})", error.what()),
                     kGivePackage);
  }
}

LoadedPackage load_package(const std::filesystem::path& path) {
  const TensorFile file = load_tensor_file(path);
  LoadedPackage loaded{package_of(file, path.string()), nullptr};
  check_finite(file, path.string());
  loaded.network = make_network(loaded.package.network, file, path.string());
  loaded.network->eval();
  return loaded;
}

torch::Tensor noise_level_of(const NetworkPackage& package, const torch::Tensor& input) {
  const std::int64_t before =
      package.planes() * (package.settings.guide == "none" ? std::int64_t{1} : std::int64_t{2});
  return input.size(1) > before ? input.slice(1, before) : torch::ones_like(input.slice(1, 0, 1));
}

namespace {

// What the network gives for light that it was trained with.
torch::Tensor whole_output(Network& network, const NetworkPackage& package,
                           const torch::Tensor& input) {
  const std::int64_t planes = package.planes();
  const torch::Tensor base = input.slice(1, 0, planes);
  if (package.settings.noise_input != "units") {
    const torch::Tensor output = network.forward(input).slice(1, 0, package.output_planes());
    return package.settings.residual && !adds_input(package) ? output + base : output;
  }
  const torch::Tensor level = noise_level_of(package, input);
  std::vector<torch::Tensor> seen{base / (kSeenDeviations * level)};
  if (package.settings.guide != "none")
    seen.push_back((input.slice(1, planes, 2 * planes) - base) / level);
  seen.push_back(level);
  torch::Tensor output = network.forward(torch::cat(seen, 1)).slice(1, 0, planes);
  if (adds_input(package)) output = output - seen.front();
  return package.settings.residual ? base + level * output : level * output;
}

}  // namespace

torch::Tensor apply_network(Network& network, const NetworkPackage& package,
                            const torch::Tensor& input) {
  const torch::Tensor output = whole_output(network, package, input);
  if (!package.corrects_guide() || !std::isfinite(package.brightest)) return output;
  const torch::Tensor guide = input.slice(1, 0, package.planes());
  return guide + share_of_correction(package, input) * (output - guide);
}

}  // namespace malus
