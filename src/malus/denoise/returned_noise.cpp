#include "malus/denoise/internal/returned_noise.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/gaussian_means.h"

#include <algorithm>
#include <cstddef>

namespace malus::internal {
namespace {

// Means over this neighbourhood, in cells. Of noise alone they have a deviation of a fifteenth, so
// that half of it is never seen where the filter took the rest away.
constexpr float kReturnedDeviation = 1.5f;
constexpr int kReturnedRadius = 4;
// Squared residuals of this share of the noise and above are those of a filter that works: what it
// states of itself holds (docs/uncertainty.md, "Texture that is returned").
constexpr float kFiltered = 0.5f;
// Of the noise of a sample that is returned. Such errors are not shared, but a share of them is
// taken to be so in S1 and S2 (polar/uncertainty.cpp), where it cancels: 1 would be true of the
// pixel, 1.5 of S1 and S2.
constexpr float kOfReturned = 1.2f;
constexpr int kCellRowsOfTask = 8;

// Sums over the cells.
struct CellSums {
  Image rest;      // squared residuals
  Image variance;  // of the noise
};

CellSums sum_cells(const FrameSource& frame, const SampleNoise& noise, const Image& estimate) {
  const int down = cell_count(frame.rows), across = cell_count(frame.cols);
  CellSums cells{Image(down, across), Image(down, across)};
  parallel_for(0, down, kCellRowsOfTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin) * kCell;
         r < std::min(static_cast<int>(end) * kCell, frame.rows); ++r)
      for (int c = 0; c < frame.cols; ++c) {
        const auto channel = static_cast<std::size_t>(frame.layout.channel_at(r, c));
        const float value = estimate(r, c);
        if (value > noise.uncut[channel] || noise.hidden(channel, value)) continue;
        const float variance = noise.variance(channel, value);
        const float rest = frame.pixel(r, c) - value;
        cells.rest(r / kCell, c / kCell) += rest * rest;
        cells.variance(r / kCell, c / kCell) += variance;
      }
  });
  return cells;
}

}  // namespace

void state_returned_noise(const FrameSource& frame, const SampleNoise& noise, const Image& estimate,
                          Image& error) {
  CellSums cells = sum_cells(frame, noise, estimate);
  for (Image* sum : {&cells.rest, &cells.variance})
    *sum = gaussian_means(*sum, kReturnedDeviation, kReturnedRadius);
  parallel_for(0, frame.rows, kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (auto r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < frame.cols; ++c) {
        const float whole = kFiltered * cells.variance(r / kCell, c / kCell),
                    rest = cells.rest(r / kCell, c / kCell);
        if (!(rest < whole)) continue;
        const auto channel = static_cast<std::size_t>(frame.layout.channel_at(r, c));
        const float value = estimate(r, c);
        if (value > noise.uncut[channel] || noise.hidden(channel, value)) continue;
        error(r, c) = std::max(error(r, c),
                               kOfReturned * (1 - rest / whole) * noise.variance(channel, value));
      }
  });
}

}  // namespace malus::internal
