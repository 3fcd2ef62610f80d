#include "table_s1_frames.h"

#include "malus/synthesize/equivalent_models.h"
#include "malus/synthesize/renoise.h"
#include "malus/synthesize/synthesizer.h"

#include <memory>

namespace malus::app {
namespace {

FrameMaker noise_on_noise(const NoiseModel& model, const GainSetting& from, const GainSetting& to,
                          const std::string& noise) {
  if (noise == "HG") {
    const auto added = std::make_shared<CompiledNoise>(gaussian_difference(
        model.layout, gaussian_of(model, from), gaussian_of(model, to), model.quantization_dn));
    return [added](const Image& noisy_dn, const Image& guide_dn, const DrawAddress& address) {
      return gaussian_on_noise(*added, noisy_dn, guide_dn, address);
    };
  }
  const double white_dn = white_above_black(model.white_dn, model.black_dn);
  std::shared_ptr<const Renoiser> renoiser;
  if (!model.nonparametric.empty()) {
    renoiser = std::make_shared<Renoiser>(model.layout, model.nonparametric_at(from),
                                          model.nonparametric_at(to), model.row_group, white_dn,
                                          model.quantization_dn);
  } else {
    PhysicsNoise target = model.physics_at(to);
    target.parts.quantization = false;  // the camera's rounding is drawn later
    renoiser = std::make_shared<Renoiser>(model.physics_at(from), target, white_dn);
  }
  return [renoiser](const Image& noisy_dn, const Image& guide_dn, const DrawAddress& address) {
    Image dn(noisy_dn.rows(), noisy_dn.cols());
    renoiser->apply(noisy_dn, guide_dn, dn, address);
    return dn;
  };
}

// The calibrated noise of the noisier gain on the denoised frame.
FrameMaker calibrated(const NoiseModel& model, const GainSetting& to, const std::string& noise) {
  SynthesisSettings settings;
  const SynthesisKind kind = noise == "HG"                  ? SynthesisKind::kGaussian
                             : !model.nonparametric.empty() ? SynthesisKind::kNonparametric
                                                            : SynthesisKind::kPhysics;
  settings.kind = synthesis_kind_name(kind);
  if (kind == SynthesisKind::kPhysics) settings.parameters = "mean";
  settings.quantization = kind == SynthesisKind::kNonparametric;  // rounding is a part of those
  const auto synthesizer = std::make_shared<Synthesizer>(
      noise == "HG" ? with_equivalents(model, {to}) : model, settings);
  return [synthesizer, to](const Image&, const Image& guide_dn, const DrawAddress& address) {
    return synthesizer->draw(guide_dn, to, second_noise(address)).dn;
  };
}

}  // namespace

FrameMaker frame_maker(const TableS1Row& row, const NoiseModel& model, const GainSetting& from,
                       const GainSetting& to) {
  return row.scheme == "calibrated" ? calibrated(model, to, row.noise)
                                    : noise_on_noise(model, from, to, row.noise);
}

}  // namespace malus::app
