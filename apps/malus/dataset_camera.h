// What draws the noise of a data set: a calibrated model, or a trained Noise Flow.
#pragma once

#include "malus/noise/model.h"
#include "malus/synthesize/dataset.h"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus::app {

class DatasetCamera {
 public:
  virtual ~DatasetCamera() = default;
  /// Before samples are drawn. Throws InputError as Synthesizer, and on settings that mean nothing
  /// to a flow.
  virtual void prepare() = 0;
  /// Layout, levels and row group; a flow's holds no calibration.
  virtual const NoiseModel& camera() const = 0;
  /// The settings that its noise follows: of a flow, debias and amplify alone.
  virtual nlohmann::ordered_json noise_json() const = 0;
  /// A sample, without gain in its recipe at a random one: of a flow, one that it was trained at.
  /// Any thread. Throws InputError.
  virtual TrainingPair pair(const SampleRecipe& recipe, View<const float> source_dn,
                            std::uint64_t seed) const = 0;
  /// Throws InputError on listed gains that no sample could be drawn at.
  virtual void try_gains() const = 0;
  /// What speaks against the listed gains, and against patches of this size: lines for warnings.
  virtual std::vector<std::string> cautions() const = 0;
};

/// model: a noise model's file or built-in name, or a Noise Flow's file; settings.ratio is not
/// looked at. Throws InputError as load_model.
std::unique_ptr<DatasetCamera> open_dataset_camera(const std::filesystem::path& model,
                                                   const DatasetSettings& dataset,
                                                   const SynthesisSettings& noise);

}  // namespace malus::app
