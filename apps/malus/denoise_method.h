// The method of one `malus denoise` run: a classical one by name, or a network from a weight file.
#pragma once

#include "malus/denoise/denoiser.h"
#include "malus/neural/inference.h"

#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus::app {

class NetworkDenoiser;

/// Throws InputError unless name is a classical method's or ends like a weight file's.
void require_method(const std::string& name);

class FrameDenoiser {
 public:
  /// Opens the weight file where settings.method ends in .safetensors; inference holds its
  /// settings; warns where the precision that they ask for is not taken. Throws InputError on an
  /// unknown method, CLI::ValidationError where uncertainty is asked of one that gives none.
  FrameDenoiser(const DenoiseSettings& settings, const InferenceSettings& inference,
                bool uncertainty);
  ~FrameDenoiser();

  /// held_values: see DenoiseSettings.
  Denoised operator()(RawFrame frame, const NoiseProfile& profile, Progress& progress,
                      double held_values = 0) const;
  /// "mosaic", or the pictures that a network gives in its place, "rgb" or "srgb".
  std::string target() const;
  /// Whether light that the camera cut off at 0 is worked out: not by linear networks.
  bool undoes_cut_off() const;
  /// Throws InputError for a flag of InferenceSettings that the method would not look at.
  void require_used(const std::vector<std::string>& inference_flags) const;
  /// Of a network that gives pictures (malus/neural/inference.h).
  NetworkInference::Rendered render(RawFrame frame, const NoiseProfile& profile,
                                    Progress& progress) const;
  /// For the record of a run; null for a classical method, whose settings say everything.
  nlohmann::ordered_json description() const;

 private:
  bool takes_ratio() const;  ///< whether InferenceSettings' ratio changes anything

  DenoiseSettings settings_;
  bool uncertainty_;
  std::unique_ptr<NetworkDenoiser> network_;
};

}  // namespace malus::app
