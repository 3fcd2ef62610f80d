#include "malus/synthesize/scene_frames.h"

#include "malus/base/error.h"
#include "malus/image/middle.h"
#include "malus/synthesize/internal/site_light.h"
#include "malus/synthesize/synthesizer.h"

#include <algorithm>

namespace malus {
namespace {

// What a pixel behind the site's colour filter and polarizer sees.
double light_at(const std::vector<Planes>& light, const Site& site, int row, int col) {
  const auto value = [&](std::size_t angle) {
    return light_behind_filter(site.color, light[angle].channels(),
                               [&](int color) { return double{light[angle][color](row, col)}; });
  };
  if (light.size() == 1) return value(0);
  if (site.angle_deg) return value(static_cast<std::size_t>(*site.angle_deg / 45));
  return (value(0) + value(1) + value(2) + value(3)) / 4;
}

}  // namespace

CleanScene clean_scene(const std::string& source, const std::vector<Planes>& light,
                       const NoiseModel& model, int crop) {
  MALUS_REQUIRE(light.size() == 1 || light.size() == 4);
  if (light.size() == 1 && model.layout.polarized())
    throw InputError(source, "is one picture, the model of a polarization camera",
                     "give folders with I0, I45, I90 and I135, or the model of another camera");
  Image whole(light[0].rows(), light[0].cols());
  for (int r = 0; r < whole.rows(); ++r)
    for (int c = 0; c < whole.cols(); ++c) {
      const int channel = model.layout.channel_at(r, c);
      const double white = model.white_dn - model.black_dn[static_cast<std::size_t>(channel)];
      // No sensor tells how much brighter than white light is: there the truth ends, too.
      const double seen = std::min(light_at(light, model.layout.site(channel), r, c), 1.0);
      whole(r, c) = static_cast<float>(white * seen);
    }
  CleanScene scene{source, middle_of(whole, model.layout, crop)};
  if (scene.clean_dn.values().empty())
    throw InputError(source, "is smaller than one cell of the sensor's mosaic",
                     "give a larger picture");
  return scene;
}

RawFrame noisy_frame(const CleanScene& scene, const LightCase& light,
                     const std::shared_ptr<const NoiseModel>& camera, std::uint64_t seed) {
  SynthesisSettings synthesis;
  synthesis.ratio = light.ratio;
  RawFrame frame = Synthesizer(camera, synthesis)
                       .draw_raw(scene.clean_dn, camera->setting_of(light.gain),
                                 DrawAddress{.seed = seed}, camera->black_dn, camera->white_dn);
  frame.source = scene.name;
  return frame;
}

}  // namespace malus
