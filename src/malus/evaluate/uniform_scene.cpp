#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/evaluate/noise_comparison.h"
#include "malus/image/pack.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

Moments moments_over(const Image& image) {
  Moments moments;
  for (const float v : image.values())
    if (std::isfinite(v)) moments.add(static_cast<double>(v));
  return moments;
}

}  // namespace

Image uniform_scene(const NoiseFrames& lit, const NoiseFrames& unlit, const SensorLayout& layout) {
  constexpr double kDark = 0.05;  // of the noise
  const int frames = std::min({lit.count, unlit.count, kMostSceneFrames});
  MALUS_REQUIRE(frames > 0);
  const auto channels = static_cast<std::size_t>(layout.channels());
  std::vector<double> light(channels), variance(channels);
  int rows = 0, cols = 0;
  for (int f = 0; f < frames; ++f) {
    const Image with = lit.load(f), without = unlit.load(f);
    rows = without.rows();
    cols = without.cols();
    const Planes bright = pack(with, layout), dark = pack(without, layout);
    for (std::size_t k = 0; k < channels; ++k) {
      const Moments noise = moments_over(dark[static_cast<int>(k)]);
      light[k] += (moments_over(bright[static_cast<int>(k)]).mean() - noise.mean()) / frames;
      variance[k] += noise.variance() / frames;
    }
  }
  Image scene(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const auto k = static_cast<std::size_t>(layout.channel_at(r, c));
      if (light[k] > kDark * std::sqrt(variance[k])) scene(r, c) = static_cast<float>(light[k]);
    }
  return scene;
}

}  // namespace malus
