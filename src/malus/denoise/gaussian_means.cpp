#include "malus/denoise/internal/gaussian_means.h"

#include "malus/base/parallel.h"

#include <cmath>
#include <vector>

namespace malus::internal {
namespace {

// Along columns (down) or rows. taps: from -radius to radius.
Image means_along(const Image& from, const std::vector<float>& taps, bool down) {
  const int radius = static_cast<int>(taps.size()) / 2;
  Image to(from.rows(), from.cols());
  const int size = down ? from.rows() : from.cols();
  parallel_for(0, from.rows(), kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < from.cols(); ++c) {
        float sum = 0, weight = 0;
        for (int t = -radius; t <= radius; ++t) {
          const int at = (down ? r : c) + t;
          if (at < 0 || at >= size) continue;
          const float tap = taps[static_cast<std::size_t>(t + radius)];
          sum += tap * (down ? from(at, c) : from(r, at));
          weight += tap;
        }
        to(r, c) = sum / weight;
      }
  });
  return to;
}

}  // namespace

Image gaussian_means(const Image& from, float deviation, int radius) {
  std::vector<float> taps;
  for (int i = -radius; i <= radius; ++i)
    taps.push_back(std::exp(-0.5f * static_cast<float>(i * i) / (deviation * deviation)));
  return means_along(means_along(from, taps, false), taps, true);
}

}  // namespace malus::internal
