#include "malus/denoise/internal/gaussian_means.h"

#include "malus/base/parallel.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace malus::internal {
namespace {

// Of a line: to[c] += tap * from[c + shift], as far as there is one. taps: from -radius to radius.
// One tap after the other, for pixels beside each other are added at once.
void add_along(const float* from, int size, const std::vector<float>& taps, float* to) {
  const int radius = static_cast<int>(taps.size()) / 2;
  for (int shift = -radius; shift <= radius; ++shift) {
    const float tap = taps[static_cast<std::size_t>(shift + radius)];
    const int begin = std::max(-shift, 0), end = std::min(size - shift, size);
    for (int c = begin; c < end; ++c) to[c] += tap * from[c + shift];
  }
}

// Where taps lie outside the others count.
Image means_along_rows(const Image& from, const std::vector<float>& taps) {
  const int size = from.cols();
  const std::vector<float> ones(static_cast<std::size_t>(size), 1.0f);
  std::vector<float> weights(ones.size());
  add_along(ones.data(), size, taps, weights.data());
  Image to(from.rows(), size);
  parallel_for(0, from.rows(), kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r) {
      add_along(from.row(r), size, taps, to.row(r));
      for (int c = 0; c < size; ++c) to(r, c) /= weights[static_cast<std::size_t>(c)];
    }
  });
  return to;
}

Image means_along_columns(const Image& from, const std::vector<float>& taps) {
  const int radius = static_cast<int>(taps.size()) / 2;
  Image to(from.rows(), from.cols());
  parallel_for(0, from.rows(), kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r) {
      float weight = 0, *sums = to.row(r);
      for (int t = std::max(-radius, -r); t <= std::min(radius, from.rows() - 1 - r); ++t) {
        const float tap = taps[static_cast<std::size_t>(t + radius)], *values = from.row(r + t);
        weight += tap;
        for (int c = 0; c < from.cols(); ++c) sums[c] += tap * values[c];
      }
      for (int c = 0; c < from.cols(); ++c) sums[c] /= weight;
    }
  });
  return to;
}

}  // namespace

Image gaussian_means(const Image& from, float deviation, int radius) {
  std::vector<float> taps;
  for (int i = -radius; i <= radius; ++i)
    taps.push_back(std::exp(-0.5f * static_cast<float>(i * i) / (deviation * deviation)));
  return means_along_columns(means_along_rows(from, taps), taps);
}

}  // namespace malus::internal
