// Fits a Noise Flow to pairs of noisy and clean frames by maximum likelihood. Names no libtorch
// type.
#pragma once

#include "malus/base/parameter.h"
#include "malus/base/progress.h"
#include "malus/neural/noise_flow_file.h"
#include "malus/neural/training_config.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace malus {

struct NoiseFlowSettings {
  int couplings = 8, width = 16, steps = 1500, batch = 16, crop = 24;
  double learning_rate = 2e-3;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.couplings, ParameterInfo{"couplings", "1", "invertible steps in all", 0, 64});
    field(self.width, ParameterInfo{"width", "1", "channels of a coupling's network", 1, 256});
    field(self.steps, ParameterInfo{"steps", "1", "training steps", 1, 1e7});
    field(self.batch, ParameterInfo{"batch", "1", "crops per step", 1, 4096});
    field(self.crop, ParameterInfo{"crop", "pixel", "side of a crop in the planes", 4, 1024});
    field(self.learning_rate,
          ParameterInfo{"learning_rate", "1", "of Adam; falls to nothing by a cosine", 1e-7, 1});
  }
};

struct NoiseFlowPair {
  /// Mosaics in DN above black, of one size; what is NaN in one of them is not learnt from.
  Image noisy_dn, clean_dn;
  GainSetting gain;
  std::string name = "a pair";  ///< for messages: the noisy file
  /// Of noisy_dn's whole numbers before black was subtracted; 0: it held none.
  double step_dn = 0;
};

struct NoiseFlowFit {
  NoiseFlowModel model;
  /// steps, seconds, log: mean log-likelihood per value in nats (values in DN), by step.
  nlohmann::ordered_json record;
};

/// Frames of integers are spread over their step, so that a density exists. Crops hold no pixel
/// that is NaN. Fills the sensor's gain range. Throws InputError on no pairs, frames that are too
/// small, of unequal size or without such a crop, gains that are unknown or in two units;
/// Cancelled.
NoiseFlowFit train_noise_flow(NoiseFlowSensor sensor, const std::vector<NoiseFlowPair>& pairs,
                              const NoiseFlowSettings& settings, std::uint64_t seed,
                              Progress& progress = silent_progress());

/// Whether a training configuration asks for a Noise Flow.
bool is_noise_flow_config(const std::filesystem::path& config,
                          const std::vector<std::string>& settings);

/// A pair as files.
struct NoiseFlowFiles {
  std::filesystem::path noisy, clean;
  GainSetting gain;  ///< unknown: what the noisy file tells
  double ratio = 1;  ///< light of the clean frame over that of the noisy one
  /// The clean frame still holds the sensor's bias at this gain.
  std::optional<GainSetting> bias_at = {};
};

/// The training that a configuration describes: [network] architecture = "noise-flow"; [sensor]
/// layout, black, white; [[pairs]] noisy (files or patterns, of which a stack counts as its frames;
/// io/frame_stack.h), clean (one frame, which all of them share), gain_db or iso; [train] settings.
struct NoiseFlowConfig {
  std::filesystem::path source;
  NoiseFlowSensor sensor;
  NoiseFlowSettings settings;
  std::vector<NoiseFlowFiles> pairs;
  std::filesystem::path model;  ///< the calibrated one that overrides name; else empty
};

/// overrides.pairs: lists of captured pairs (io/pair_list.h) in place of [[pairs]];
/// overrides.models: one calibrated model in place of [sensor]; settings as in ConfigSection::load.
/// Throws InputError. Of frames no more is read than how many a stack holds.
NoiseFlowConfig load_noise_flow_config(const std::filesystem::path& config,
                                       const TrainingOverrides& overrides = {});

/// Settings, sensor and what the pairs' files hold: trainings of the same with one seed give the
/// same flow. Throws InputError where a file cannot be read.
nlohmann::json config_json(const NoiseFlowConfig& config);

NoiseFlowFit train_noise_flow(const NoiseFlowConfig& config, std::uint64_t seed,
                              Progress& progress = silent_progress());

struct TrainOptions;

/// `malus train` of a Noise Flow into options.folder, as that of a network (trainer.h), but for
/// checkpoints, which it keeps none of: with `resume` a finished training is left as it is, and any
/// other begins anew. Result: the record, "weights" and, of a finished one, "finished_before" in
/// it. Throws InputError, also where another training writes into the folder, and where a finished
/// one had other settings or files; Cancelled.
nlohmann::ordered_json train_noise_flow(const NoiseFlowConfig& config, const TrainOptions& options,
                                        Progress& progress);

}  // namespace malus
