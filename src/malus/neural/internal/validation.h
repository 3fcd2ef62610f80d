// How well a network denoises frames that it was not trained on: scenes with known light, a
// camera's noise at fixed gains and light, the metrics of 000 Table 1. Scored is what inference.h
// gives of such a frame in one piece, the limits on a guide's corrections included.
#pragma once

#include "malus/base/progress.h"
#include "malus/neural/package.h"
#include "malus/neural/training_config.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace malus {

/// The files of save_sample, without their ending.
inline constexpr const char* kSampleNames[] = {"noisy", "guide", "network", "clean"};

struct ValidationScore {
  /// Means over the frames. Of pictures the image alone, as the network's target has it; "noisy"
  /// and "guide" are then demosaicked.
  double image_psnr_db = 0;
  std::optional<double> dolp_psnr_db, aolp_circular_deg;  ///< over the frames that have them
};

/// As the log holds it; and what the best one is chosen by, NaN where a metric in it is none.
nlohmann::ordered_json json_of(const ValidationScore& score);
double summed_db(const nlohmann::ordered_json& score);

/// A sample's files in folder as a report's pictures (docs/report.md), names relative to folder's
/// parent; of those that are there.
nlohmann::ordered_json sample_entry(const TrainingConfig& config,
                                    const std::filesystem::path& folder);

class Validation {
 public:
  /// Makes the frames of config.validation_scenes (folders of angles, or pictures) at config.cases
  /// with the first noise model, and their guides: once. Throws InputError.
  Validation(const TrainingConfig& config, std::uint64_t seed, Progress& progress);
  bool empty() const { return frames_.empty(); }
  /// What to warn of, whole lines.
  const std::vector<std::string>& complaints() const { return complaints_; }

  /// package: with the brightest light of training, beyond which a guide stands.
  /// Throws Cancelled between two frames where a stop is requested.
  ValidationScore score(Network& network, const NetworkPackage& package,
                        const Progress& progress) const;
  /// Writes the first frame as float mosaics (.npy, DN above black in the clean scene's light) into
  /// folder: noisy, the guide if any, the network's result, clean. Contract: not empty(), and a
  /// network that gives mosaics.
  void save_sample(Network& network, const NetworkPackage& package,
                   const std::filesystem::path& folder) const;
  ValidationScore noisy_score() const { return noisy_; }
  ValidationScore guide_score() const { return guide_; }  ///< zero without a guide

 private:
  struct Frame {
    NetworkFrame noisy;
    Image reference_dn;       ///< before the light was divided by ratio
    Planes reference_rgb_dn;  ///< the same as R, G, B, for networks that give pictures
    double ratio;
    double peak_dn;
  };
  torch::Tensor output(const Frame& frame, Network& network, const NetworkPackage& package) const;
  Image result(const Frame& frame, Network& network, const NetworkPackage& package) const;
  /// Of mosaics in DN above black at the frames' light; shown as pictures where the target is one.
  ValidationScore mean_score(const std::vector<Image>& mosaics) const;
  ValidationScore picture_score(const std::vector<torch::Tensor>& pictures) const;

  PackageSettings settings_;
  std::vector<Frame> frames_;
  ValidationScore noisy_, guide_;
  std::vector<std::string> complaints_;
};

}  // namespace malus
