#include "malus/denoise/internal/coarse_scale.h"

#include "malus/base/parallel.h"

#include <algorithm>
#include <cmath>

namespace malus::internal {
namespace {

int halved(int size, int period) { return size / (2 * period) * period; }

// Smooths along one axis by [1 2 1] / 4 over neighbours `period` apart, the border repeated.
void smooth_axis(const Image& from, Image& to, int period, bool along_rows) {
  const int size = along_rows ? from.rows() : from.cols();
  parallel_for(0, from.rows(), 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < from.cols(); ++c) {
        const int at = along_rows ? r : c;
        const int before = at >= period ? at - period : at;
        const int after = at + period < size ? at + period : at;
        const float neighbours =
            along_rows ? from(before, c) + from(after, c) : from(r, before) + from(r, after);
        to(r, c) = 0.5f * from(r, c) + 0.25f * neighbours;
      }
  });
}

// Where a pixel lies between the samples of its channel in the coarse frame.
struct Between {
  int first, second;
  float share;  // of the second
};

std::vector<Between> positions(int size, int coarse, int period) {
  std::vector<Between> result;
  for (int i = 0; i < size; ++i) {
    const double at = (i / period - 0.5) / 2;
    const int last = coarse / period - 1;
    const int below = static_cast<int>(std::floor(at));
    const auto pixel = [&](int cell) { return std::clamp(cell, 0, last) * period + i % period; };
    result.push_back({pixel(below), pixel(below + 1), static_cast<float>(at - below)});
  }
  return result;
}

}  // namespace

std::optional<CoarseSize> coarse_size(int rows, int cols, const SensorLayout& layout) {
  if (rows < kLeastCoarsePeriods * layout.rows() || cols < kLeastCoarsePeriods * layout.cols())
    return std::nullopt;
  return CoarseSize{halved(rows, layout.rows()), halved(cols, layout.cols())};
}

Image coarse_frame(const FrameSource& frame) {
  const PixelSource& pixel = frame.pixel;
  const int down = frame.layout.rows(), across = frame.layout.cols();
  Image coarse(halved(frame.rows, down), halved(frame.cols, across));
  parallel_for(0, coarse.rows(), 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < coarse.cols(); ++c) {
        const int row = r / down * 2 * down + r % down, col = c / across * 2 * across + c % across;
        coarse(r, c) = 0.5f * (pixel(row, col) + pixel(row, col + across) + pixel(row + down, col) +
                               pixel(row + down, col + across));
      }
  });
  return coarse;
}

void correct_low_frequencies(Image& estimate, const Image& coarse_estimate,
                             const SensorLayout& layout) {
  const int rows = estimate.rows(), cols = estimate.cols();
  Image difference = coarse_frame(source_of(estimate, layout));
  MALUS_REQUIRE(difference.rows() == coarse_estimate.rows() &&
                difference.cols() == coarse_estimate.cols());
  for (std::size_t i = 0; i < difference.size(); ++i)
    difference.values()[i] = 0.5f * (coarse_estimate.values()[i] - difference.values()[i]);
  Image smooth(difference.rows(), difference.cols());
  smooth_axis(difference, smooth, layout.rows(), true);
  smooth_axis(smooth, difference, layout.cols(), false);
  const auto row_at = positions(rows, difference.rows(), layout.rows());
  const auto col_at = positions(cols, difference.cols(), layout.cols());
  parallel_for(0, rows, 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r) {
      const Between& v = row_at[static_cast<std::size_t>(r)];
      const float *above = difference.row(v.first), *below = difference.row(v.second);
      for (int c = 0; c < cols; ++c) {
        const Between& h = col_at[static_cast<std::size_t>(c)];
        const float top = above[h.first] + h.share * (above[h.second] - above[h.first]);
        const float bottom = below[h.first] + h.share * (below[h.second] - below[h.first]);
        estimate(r, c) += top + v.share * (bottom - top);
      }
    }
  });
}

}  // namespace malus::internal
