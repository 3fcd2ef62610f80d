// malus.Model: a model with the sampler of its last settings.
#pragma once

#include "malus/synthesize/model.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "settings.h"
#include <pybind11/pybind11.h>

namespace malus::python {

using Gain = std::optional<double>;  ///< in the model's unit; empty: random

/// A training loop calls synthesize with the same settings again and again: their sampler, which
/// keeps its tables of the gains drawn last, is kept until others come.
class ModelWithSampler {
 public:
  explicit ModelWithSampler(Model model) : model_(std::move(model)) {}

  /// Called with the interpreter's lock, which guards the cache.
  NoiseAtGain noise(const Gain& gain, const pybind11::kwargs& kwargs) {
    // Converted first: different objects may have one repr, and the same object other values later.
    const auto settings = settings_from<SynthesisSettings>(kwargs);
    auto values = values_of(settings);
    if (!sampler_ || values != values_) {
      last_.reset();
      sampler_ = model_.at_random_gain(settings);
      values_ = std::move(values);
    }
    if (!last_ || gain != gain_) {
      last_ = sampler_->with_gain(gain);
      gain_ = gain;
    }
    return *last_;
  }
  const Model& model() const { return model_; }
  const NoiseModel& description() const { return model_.description(); }

 private:
  Model model_;
  std::vector<std::string> values_;  ///< of sampler_'s settings
  std::optional<NoiseAtGain> sampler_;
  Gain gain_;
  std::optional<NoiseAtGain> last_;  ///< of gain_
};

/// A Model, the name or path of one, or None. Throws TypeError, InputError.
std::optional<Model> model_from(const pybind11::object& given);

/// Throws InputError for an argument that is given, but without a model has no meaning.
void require_model_for(const char* name, bool given, const std::optional<Model>& model);

/// complaints_at_gain (malus/denoise/frame_complaints.h), by the sensor's name.
std::vector<std::string> model_complaints(const NoiseModel& model, const GainSetting& gain,
                                          bool undone);

/// untold_gain_complaint (malus/noise/frame_levels.h), by the sensor's name.
std::string untold_gain_line(const NoiseModel& model, const std::vector<GainSetting>& asked);

}  // namespace malus::python
