// What a synthesizer works out once per gain: parameters, quantile tables, alias tables. Drawing
// many frames at one gain then costs the sampling alone.
#pragma once

#include "malus/noise/level_noise.h"
#include "malus/noise/model.h"
#include "malus/noise/parameter_sampler.h"
#include "malus/synthesize/compiled.h"
#include "malus/synthesize/level_sampler.h"

#include <functional>
#include <list>
#include <memory>
#include <optional>
#include <vector>

namespace malus {

/// Of what is written; and white where none is known.
inline constexpr double kHighestInteger = 65535.0;

/// One kind of noise at one gain; the members that the kind does not use are empty.
struct GainTables {
  GainSetting gain;
  std::optional<ParameterSampler> parameters;  ///< physics, poisson-gaussian, dark-frames
  std::optional<CompiledNoise> compiled;       ///< all but nonparametric; of the mean parameters
  std::optional<LevelSampler> levels;          ///< nonparametric
  std::vector<LevelRange> level_ranges;        ///< nonparametric
  std::optional<LevelSampler> rounded_levels;  ///< for output that will be rounded, where that
                                               ///< differs
  double global_bias_dn = 0;  ///< the mean frame's bias, mean over the channels; 0 without bias
};

/// Draws the measured noise of a model's calibration up to white. rounded_later: into output that
/// will be rounded to the camera's step. row_group 0: no row noise.
LevelSampler sampler_of_levels(const NoiseModel& model, const NonparametricCalibration& calibration,
                               int row_group, bool rounded_later);

/// The tables of the gains drawn last. Safe to use from several threads, and in a process that was
/// forked while they drew.
class GainTableCache {
 public:
  /// The gain's tables, made by `make` where they are not held. Two threads that miss at the same
  /// time both make them; what make throws passes through.
  std::shared_ptr<const GainTables> at(
      const GainSetting& gain, const std::function<GainTables(const GainSetting& gain)>& make);

 private:
  std::list<std::shared_ptr<const GainTables>> recent_;  ///< latest first
};

}  // namespace malus
