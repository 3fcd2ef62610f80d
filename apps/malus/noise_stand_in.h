// Frames that are drawn in place of a camera's, to be compared with its own: by a calibrated model
// or a Noise Flow.
#pragma once

#include "malus/evaluate/noise_comparison.h"
#include "malus/image/raw_frame.h"
#include "malus/noise/model.h"
#include "malus/synthesize/synthesizer.h"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>

namespace malus::app {

/// Frames in DN above black, rounded and clipped as the camera's are, or not.
struct StandIn {
  NoiseModel levels;  ///< layout, black and white level alone
  /// Throws InputError on a gain that it does not know.
  std::function<Image(const Image& clean_dn, const GainSetting& gain, const DrawAddress& address,
                      bool rounded)>
      draw;
  /// Says what speaks against frames of this gain.
  std::function<void(const GainSetting& gain)> warn_of_gain = [](const GainSetting&) {};
};

/// One kind of a model's noise; file: for warnings. Throws InputError as Synthesizer.
StandIn calibrated_stand_in(std::shared_ptr<const NoiseModel> model,
                            const std::filesystem::path& file, const SynthesisSettings& settings);
/// Throws InputError where the file is no Noise Flow.
StandIn flow_stand_in(const std::filesystem::path& file);

/// The address of a drawn frame. Their numbers begin high: the camera's frames may be what
/// synthesize drew of the same seed, and noise must not be compared with itself.
DrawAddress stand_in_address(std::uint64_t seed, int frame);

/// `count` frames of the clean scene, of frames of a uniform one (uniform_scene) where there is
/// none, at the gain of the reference's first frame; rounded and clipped where that is of whole
/// numbers.
NoiseFrames frames_drawn(const StandIn& stand_in, const NoiseFrames& reference,
                         const RawFrame& first, const std::optional<Image>& clean_dn, int count,
                         std::uint64_t seed);

}  // namespace malus::app
