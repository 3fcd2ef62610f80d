// Frames of known scenes, as a calibrated camera takes them: what experiments on denoising measure
// by.
#pragma once

#include "malus/image/view.h"
#include "malus/noise/model.h"
#include "malus/synthesize/light_case.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace malus {

struct CleanScene {
  std::string name;  ///< of what it was made of
  Image clean_dn;    ///< mosaic, DN above black, at most the camera's white
};

/// The middle crop x crop pixels of a scene through the sensor's mosaic. light: fractions of white,
/// of one size, with one plane or red, green and blue; behind polarizers at 0, 45, 90 and 135
/// degrees, whose mean a sensor without polarizers sees, or one without. Sites without a colour
/// filter see the mean of the colours. Throws InputError, naming the source, where one is given for
/// a sensor with polarizers, and where nothing is left.
CleanScene clean_scene(const std::string& source, const std::vector<Planes>& light,
                       const NoiseModel& model, int crop);

/// One noisy frame of it. The same seed gives the same frame. Throws InputError as Synthesizer.
RawFrame noisy_frame(const CleanScene& scene, const LightCase& light,
                     const std::shared_ptr<const NoiseModel>& camera, std::uint64_t seed);

}  // namespace malus
