// What malus_networks.so gives to those who open it.
#include "malus/base/fork.h"
#include "malus/base/wording.h"
#include "malus/neural/failures.h"
#include "malus/neural/inference.h"
#include "malus/neural/threads.h"

#include "networks.h"
#include "train.h"
#include <malus_modules_interface.h>

namespace malus::app {
namespace {

// What libtorch throws leaves the module as what the program knows.
template <class Call>
decltype(auto) guarded(const Call& call) {
  try {
    return call();
  } catch (...) {
    rethrow_libtorch_failure(
        "check weights, settings and free memory; if they are good, report this line");
  }
}

// The threads of the caller, whose number may have changed since the last call.
template <class Call>
decltype(auto) guarded_with_threads(const Call& call) {
  return guarded([&]() -> decltype(auto) {
    const NetworkThreads threads;
    return call();
  });
}

class PackageDenoiser final : public NetworkDenoiser {
 public:
  explicit PackageDenoiser(const NetworkDenoiserOptions& options)
      : inference_(options.weights, options.settings) {}
  Denoised denoise(RawFrame frame, const NoiseProfile& profile, const DenoiseSettings& settings,
                   Progress& progress, bool want_variance) override {
    return guarded_with_threads([&] {
      return inference_.denoise(std::move(frame), profile, settings, progress, want_variance);
    });
  }
  NetworkTarget target() const override { return inference_.target(); }
  NetworkInference::Rendered render(RawFrame frame, const NoiseProfile& profile,
                                    const DenoiseSettings& settings, Progress& progress) override {
    return guarded_with_threads(
        [&] { return inference_.render(std::move(frame), profile, settings, progress); });
  }
  nlohmann::ordered_json description() const override { return inference_.description(); }

 private:
  NetworkInference inference_;
};

class NoiseFlowSampler final : public FlowSampler {
 public:
  explicit NoiseFlowSampler(const std::filesystem::path& weights) : model_(weights) {}
  const NoiseFlowSensor& sensor() const override { return model_.sensor(); }
  std::string camera_name() const override { return model_.camera_name(); }
  Image draw(View<const float> clean_dn, const GainSetting& gain,
             const DrawAddress& address) override {
    return guarded([&] { return model_.draw(clean_dn, gain, address); });
  }
  RawFrame draw_raw(View<const float> clean_dn, const GainSetting& gain,
                    const DrawAddress& address) override {
    return guarded([&] { return model_.draw_raw(clean_dn, gain, address); });
  }
  NoiseProfile profile_at(const GainSetting& gain) override {
    return guarded([&] { return model_.profile_at(gain); });
  }

 private:
  NoiseFlowModel model_;
};

std::unique_ptr<FlowSampler> open_flow(const std::filesystem::path& weights) {
  return guarded([&] { return std::make_unique<NoiseFlowSampler>(weights); });
}

std::unique_ptr<NetworkDenoiser> open_denoiser(const NetworkDenoiserOptions& options) {
  return guarded_with_threads([&] { return std::make_unique<PackageDenoiser>(options); });
}

nlohmann::ordered_json train_guarded(const TrainCall& call, Progress& progress) {
  return guarded([&] { return train_network(call, progress); });
}

void check_training_guarded(const TrainCall& call) {
  guarded([&] { check_training(call); });
}

nlohmann::ordered_json import_guarded(const ImportRequest& request) {
  return guarded([&] { return import_checkpoint(request); });
}

NetworkCost measure_guarded(const NamedNetwork& network, int channels, int rows, int cols,
                            int repetitions) {
  return guarded([&] { return measure_network(network, channels, rows, cols, repetitions); });
}

void use_threads(int threads) {
  try {
    use_network_threads(threads);
  } catch (...) {
    rethrow_libtorch_failure("it asks /proc for the processor: see that /proc is there");
  }
}

void share(const Wording& wording, bool alone) {
  use_wording(wording);
  work_alone(alone);
}

std::vector<DeviceSpeed> measure_device_speed_guarded(const NamedNetwork& network,
                                                      const DeviceWork& work) {
  return guarded([&] { return measure_device_speed(network, work); });
}

}  // namespace
}  // namespace malus::app

extern "C" const malus::app::NetworkFunctions* malus_network_functions() {
  using namespace malus::app;
  static const NetworkFunctions functions{.interface = kModulesInterface,
                                          .use_threads = use_threads,
                                          .share = share,
                                          .open_denoiser = open_denoiser,
                                          .train = train_guarded,
                                          .check_training = check_training_guarded,
                                          .open_flow = open_flow,
                                          .import_checkpoint = import_guarded,
                                          .measure = measure_guarded,
                                          .named_networks = malus::named_networks,
                                          .measure_device_speed = measure_device_speed_guarded};
  return &functions;
}
