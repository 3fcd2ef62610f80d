#include "malus/synthesize/model.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/image/pack.h"

#include <algorithm>

#include <fmt/format.h>

namespace malus {
namespace {

void require_equal_sizes(View<const float> clean, View<float> noisy) {
  if (clean.rows() == noisy.rows() && clean.cols() == noisy.cols()) return;
  throw InputError("noisy array",
                   fmt::format("{}x{} against a clean one of {}x{}", noisy.rows(), noisy.cols(),
                               clean.rows(), clean.cols()),
                   "give arrays of equal size");
}

void copy(View<const float> from, View<float> to) {
  parallel_for(0, from.rows(), 64, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (int r = static_cast<int>(first); r < static_cast<int>(last); ++r)
      std::copy_n(from.row(r), from.cols(), to.row(r));
  });
}

}  // namespace

void NoiseAtGain::synthesize(View<const float> clean_dn, View<float> noisy_dn, std::uint64_t seed,
                             std::uint32_t frame, int row0, int col0) const {
  require_equal_sizes(clean_dn, noisy_dn);
  synthesizer_->draw_into(clean_dn, noisy_dn, gain_, DrawAddress{seed, frame, row0, col0});
}

void NoiseAtGain::synthesize_packed(const std::vector<View<const float>>& clean_dn,
                                    const std::vector<View<float>>& noisy_dn, std::uint64_t seed,
                                    std::uint32_t frame) const {
  const auto& layout = synthesizer_->model().layout;
  if (static_cast<int>(clean_dn.size()) != layout.channels() || noisy_dn.size() != clean_dn.size())
    throw InputError("packed array",
                     fmt::format("{} planes for the {} channels of {}", clean_dn.size(),
                                 layout.channels(), layout.name()),
                     "give one plane per channel, in mosaic order");
  Planes planes(layout.channels(), clean_dn[0].rows(), clean_dn[0].cols());
  for (int k = 0; k < layout.channels(); ++k) {
    const auto& plane = clean_dn[static_cast<std::size_t>(k)];
    require_equal_sizes(plane, planes[k]);
    require_equal_sizes(plane, noisy_dn[static_cast<std::size_t>(k)]);
    copy(plane, planes[k]);
  }
  Image mosaic(planes.rows() * layout.rows(), planes.cols() * layout.cols());
  unpack(planes, layout, mosaic);
  synthesizer_->draw_into(mosaic, mosaic, gain_, DrawAddress{seed, frame, 0, 0});
  planes = pack(mosaic, layout);
  for (int k = 0; k < layout.channels(); ++k)
    copy(planes[k], noisy_dn[static_cast<std::size_t>(k)]);
}

Model Model::load(const std::filesystem::path& path) { return Model(load_model(path)); }

Model::Model(NoiseModel description)
    : description_(std::make_shared<const NoiseModel>(std::move(description))) {}

GainSetting Model::gain_setting(double gain) const {
  const auto in_iso = [](const auto& entries) {
    return !entries.empty() && entries.front().gain.iso.has_value();
  };
  GainSetting setting;
  const auto& d = *description_;
  if (in_iso(d.physics) || in_iso(d.gaussian) || in_iso(d.nonparametric) || in_iso(d.dark_frames))
    setting.iso = gain;
  else
    setting.gain_db = gain;
  return setting;
}

NoiseAtGain Model::at_gain(double gain, const SynthesisSettings& settings) const {
  const auto setting = gain_setting(gain);
  // Refused here, not at the first draw.
  if (settings.kind == "physics")
    description_->parameters_at(setting, settings.extrapolate_gain ? GainRange::kAllowExtrapolation
                                                                   : GainRange::kCalibratedOnly);
  return {std::make_shared<const Synthesizer>(*description_, settings), setting};
}

NoiseAtGain Model::at_random_gain(const SynthesisSettings& settings) const {
  return {std::make_shared<const Synthesizer>(*description_, settings), std::nullopt};
}

}  // namespace malus
