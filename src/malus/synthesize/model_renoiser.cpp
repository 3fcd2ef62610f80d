#include "malus/synthesize/model_renoiser.h"

#include "malus/base/random.h"
#include "malus/base/settings_check.h"
#include "malus/synthesize/gain_tables.h"
#include "malus/synthesize/synthesizer.h"

#include <bit>

namespace malus {
namespace {

PhysicsNoise target_physics(const NoiseModel& model, const GainSetting& gain, bool rounded) {
  PhysicsNoise noise = model.physics_at(gain);
  noise.parts.quantization = !rounded;
  return noise;
}

Renoiser make_renoiser(const NoiseModel& model, const GainSetting& from, const GainSetting& to,
                       SynthesisKind kind, bool rounded) {
  const double white_dn = white_above_black(model.white_dn, model.black_dn);
  if (kind == SynthesisKind::kNonparametric)
    return Renoiser(model.layout, model.nonparametric_at(from), model.nonparametric_at(to),
                    model.row_group, white_dn, rounded ? model.quantization_dn : 0.0);
  return Renoiser(model.physics_at(from), target_physics(model, to, rounded), white_dn);
}

std::uint64_t seed_between(std::uint64_t seed, const GainSetting& from, const GainSetting& to) {
  PhiloxBlock gains;
  for (std::size_t i = 0; i < 2; ++i) {
    const GainSetting& gain = i == 0 ? from : to;
    const auto bits = std::bit_cast<std::uint64_t>(gain.gain_db.value_or(gain.iso.value_or(0)));
    gains.word[2 * i] = static_cast<std::uint32_t>(bits);
    gains.word[2 * i + 1] = static_cast<std::uint32_t>(bits >> 32);
  }
  const PhiloxBlock mixed = philox4x32(gains, seed);
  return std::uint64_t{mixed.word[0]} << 32 | mixed.word[1];
}

}  // namespace

ModelRenoiser::ModelRenoiser(const NoiseModel& model, const GainSetting& from,
                             const GainSetting& to, const RenoiseSettings& settings, bool rounded)
    : layout_(model.layout), from_(from), to_(to) {
  require_settings(settings);
  if (rounded) rounding_ = CameraOutput{model.black_dn, model.white_dn, model.quantization_dn};
  const SynthesisKind kind = synthesis_kind(settings.kind);
  if (settings.method == "naive") {
    if (kind == SynthesisKind::kNonparametric) {
      const NonparametricCalibration target = model.nonparametric_at(to);
      ranges_ = level_ranges(target);
      naive_levels_ = sampler_of_levels(model, target, model.row_group, rounded);
    } else {
      naive_.emplace(target_physics(model, to, rounded));
    }
    return;
  }
  if (kind == SynthesisKind::kNonparametric)
    ranges_ = common_ranges(level_ranges(model.nonparametric_at(from)),
                            level_ranges(model.nonparametric_at(to)));
  renoiser_.emplace(make_renoiser(model, from, to, kind, rounded));
}

LevelCoverage ModelRenoiser::apply(View<const float> noisy_dn, View<float> guide_dn,
                                   const DrawAddress& address) const {
  LevelCoverage coverage;
  if (!ranges_.empty())
    coverage = level_coverage(layout_, ranges_, guide_dn, address.row0, address.col0);
  DrawAddress step = address;
  step.seed = seed_between(address.seed, from_, to_);
  if (naive_)
    naive_->apply(guide_dn, guide_dn, second_noise(step));
  else if (naive_levels_)
    naive_levels_->apply(guide_dn, guide_dn, second_noise(step));
  else
    renoiser_->apply(noisy_dn, guide_dn, guide_dn, step);
  if (rounding_) round_as_camera(guide_dn, layout_, *rounding_, address.row0, address.col0);
  return coverage;
}

}  // namespace malus
