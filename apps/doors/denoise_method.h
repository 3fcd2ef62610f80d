// A method of denoising as users name it: a classical one by name, or a network by its weight file.
#pragma once

#include "malus/denoise/denoiser.h"
#include "malus/neural/inference.h"

#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus::app {

class NetworkDenoiser;

/// Whether it ends like a network's weight file.
bool is_weight_file(const std::string& method);

/// Throws InputError unless name is a classical method's or ends like a weight file's.
void require_method(const std::string& name);

/// "paper-bm3d, plane-bm3d, ...": the methods that are baselines.
std::string baseline_names();

/// What a picture that a network made tells against its frame, lines without the frame's name.
std::vector<std::string> picture_complaints(const NetworkInference::Rendered& made);

class FrameDenoiser {
 public:
  /// Opens the weight file where settings.method ends in .safetensors; inference holds its
  /// settings. Throws InputError, also on an unknown method.
  FrameDenoiser(const DenoiseSettings& settings, const InferenceSettings& inference,
                bool uncertainty);
  ~FrameDenoiser();

  /// held_values: see DenoiseSettings.
  Denoised operator()(RawFrame frame, const NoiseProfile& profile, Progress& progress,
                      double held_values = 0) const;
  /// Classical methods give mosaics.
  NetworkTarget target() const;
  /// Whether light that the camera cut off at 0 is worked out: not by linear networks, nor by
  /// baselines that do not stabilise.
  bool undoes_cut_off() const;
  /// Throws InputError for a setting of InferenceSettings that was given and that the method would
  /// not look at.
  void require_used(const std::vector<std::string>& inference_settings) const;
  /// The same of a baseline and DenoiseSettings.
  void require_used_of_filter(const std::vector<std::string>& denoise_settings) const;
  /// That another precision is taken than the one that was asked for; empty where it is not so.
  const std::string& precision_complaint() const { return precision_complaint_; }
  /// Of a network that gives pictures (malus/neural/inference.h).
  NetworkInference::Rendered render(RawFrame frame, const NoiseProfile& profile,
                                    Progress& progress) const;
  /// For the record of a run; null for a classical method, whose settings say everything.
  nlohmann::ordered_json description() const;

  bool takes_ratio() const;  ///< whether InferenceSettings' ratio changes anything

 private:
  DenoiseSettings settings_;
  bool uncertainty_;
  std::string precision_complaint_;
  std::unique_ptr<NetworkDenoiser> network_;
};

}  // namespace malus::app
