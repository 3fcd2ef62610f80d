// Noise on noise (renoise.h) by a noise model: frames of one of its gains as if taken at another.
#pragma once

#include "malus/base/parameter.h"
#include "malus/noise/model.h"
#include "malus/synthesize/compiled.h"
#include "malus/synthesize/level_coverage.h"
#include "malus/synthesize/renoise.h"
#include "malus/synthesize/synthesis_kind.h"

#include <optional>
#include <string>
#include <vector>

namespace malus {

struct RenoiseSettings {
  std::string kind = synthesis_kind_name(SynthesisKind::kPhysics), method = "noise-on-noise";

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.kind,
          ParameterInfo{.name = "kind",
                        .unit = "",
                        .help = "noise model",
                        .choices = {synthesis_kind_name(SynthesisKind::kPhysics),
                                    synthesis_kind_name(SynthesisKind::kNonparametric)}});
    field(self.method, ParameterInfo{.name = "method",
                                     .unit = "",
                                     .help = "noise-on-noise adds to the noisy frame; naive puts "
                                             "new noise on the guide",
                                     .choices = {"noise-on-noise", "naive"}});
  }
};

class ModelRenoiser {
 public:
  /// rounded: the result is that of the camera, in which rounding is the target's quantisation
  /// noise. Throws InputError where the model does not know a gain, on settings that are none of
  /// their choices, or as Renoiser.
  ModelRenoiser(const NoiseModel& model, const GainSetting& from, const GainSetting& to,
                const RenoiseSettings& settings, bool rounded);

  /// noisy_dn and guide_dn, the clean signal as a denoiser sees it: DN above black. The result
  /// takes the guide's place: DN above black, or where it is rounded the camera's, with black,
  /// clipped to 0..white. The frame begins at address.row0, address.col0. The noise is a function
  /// of the address and of the two gains: a frame that was renoised under the same seed and number
  /// gets other words at the next step. Returns how much of the guide the model knows the noise of.
  LevelCoverage apply(View<const float> noisy_dn, View<float> guide_dn,
                      const DrawAddress& address) const;

 private:
  SensorLayout layout_;
  GainSetting from_, to_;
  std::vector<LevelRange> ranges_;  ///< that a non-parametric model knows the added noise of
  std::optional<Renoiser> renoiser_;
  std::optional<CompiledNoise> naive_;
  std::optional<LevelSampler> naive_levels_;  ///< in its place for measured noise
  std::optional<CameraOutput> rounding_;
};

}  // namespace malus
