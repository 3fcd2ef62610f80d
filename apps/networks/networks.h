// The door between the program, or the Python module, and the networks. libtorch is large and must
// find its environment set before it is loaded, so everything that needs it lives in a shared
// module, malus_networks.so, that is opened when somebody asks for a network. Both sides include
// this header and nothing else of each other; it names no libtorch type, nor do the headers that it
// includes.
#pragma once

#include "malus/base/progress.h"
#include "malus/base/wording.h"
#include "malus/denoise/denoiser.h"
#include "malus/neural/device_speed.h"
#include "malus/neural/inference.h"
#include "malus/neural/measure.h"
#include "malus/neural/noise_flow_file.h"
#include "malus/neural/torch_checkpoint.h"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus::app {

/// A network with its weights, ready for many frames.
class NetworkDenoiser {
 public:
  virtual ~NetworkDenoiser() = default;
  /// As denoise_frame (malus/denoise/denoiser.h); settings.method is not looked at.
  virtual Denoised denoise(RawFrame frame, const NoiseProfile& profile,
                           const DenoiseSettings& settings, Progress& progress,
                           bool want_variance) = 0;
  virtual NetworkTarget target() const = 0;
  /// In place of denoise, of networks that give pictures.
  virtual NetworkInference::Rendered render(RawFrame frame, const NoiseProfile& profile,
                                            const DenoiseSettings& settings,
                                            Progress& progress) = 0;
  /// Architecture, parameters, device, precision and what training wrote, for the record of a run.
  virtual nlohmann::ordered_json description() const = 0;
};

struct NetworkDenoiserOptions {
  std::filesystem::path weights;
  InferenceSettings settings;
};

/// `malus train`: see malus/neural/trainer.h.
struct TrainCall {
  std::filesystem::path config, folder = {};
  bool resume = false, force = false;
  std::uint64_t seed = 0;
  /// In place of the configuration's data and noise models, where not empty.
  std::vector<std::filesystem::path> pairs = {}, models = {};
  /// In place of other settings of the configuration: "SECTION.KEY=VALUE".
  std::vector<std::string> settings = {};
};

/// A trained Noise Flow (malus/neural/noise_flow_file.h).
class FlowSampler {
 public:
  virtual ~FlowSampler() = default;
  virtual const NoiseFlowSensor& sensor() const = 0;
  virtual std::string camera_name() const = 0;
  virtual Image draw(View<const float> clean_dn, const GainSetting& gain,
                     const DrawAddress& address) = 0;
  virtual RawFrame draw_raw(View<const float> clean_dn, const GainSetting& gain,
                            const DrawAddress& address) = 0;
  virtual NoiseProfile profile_at(const GainSetting& gain) = 0;
};

/// The module's functions. They throw InputError, Cancelled.
struct NetworkFunctions {
  std::uint64_t interface;  ///< kModulesInterface of the module (cmake/ModulesInterface.cmake)
  /// For the whole process, before other calls. A network that denoises uses as many threads as
  /// malus (malus/base/parallel.h) at every call by itself.
  void (*use_threads)(int threads);
  /// What an opener with functions of its own that do not serve the module (Python's libraries see
  /// nothing of each other) shares with it before every call. alone: works_alone
  /// (malus/base/fork.h).
  void (*share)(const Wording& wording, bool alone);
  std::unique_ptr<NetworkDenoiser> (*open_denoiser)(const NetworkDenoiserOptions& options);
  nlohmann::ordered_json (*train)(const TrainCall& call, Progress& progress);
  /// What train would refuse in the configuration before its first step, without the data.
  void (*check_training)(const TrainCall& call);
  std::unique_ptr<FlowSampler> (*open_flow)(const std::filesystem::path& weights);
  nlohmann::ordered_json (*import_checkpoint)(const ImportRequest& request);
  NetworkCost (*measure)(const NamedNetwork& network, int channels, int rows, int cols,
                         int repetitions);
  std::vector<NamedNetwork> (*named_networks)();
  std::vector<DeviceSpeed> (*measure_device_speed)(const NamedNetwork& network,
                                                   const DeviceWork& work);
};

/// What the module exports, by this name.
using NetworkFunctionsEntry = const NetworkFunctions* (*)();
inline constexpr const char* kNetworkFunctionsEntry = "malus_network_functions";

}  // namespace malus::app
