#include "malus/denoise/internal/residual_evidence.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/gaussian_means.h"

#include <algorithm>
#include <cstddef>

namespace malus::internal {
namespace {

// Means over this neighbourhood, in cells. Of noise alone they have a deviation of a fifteenth, so
// that half of it is never seen where the filter took the rest away.
constexpr float kNearDeviation = 1.5f;
constexpr int kNearRadius = 4;
// Of a sixtieth.
constexpr float kWideDeviation = 6.0f;
constexpr int kWideRadius = 15;
// Squared residuals of this share of the noise and above are those of a filter that works: what it
// states of itself holds (docs/uncertainty.md, "Texture that is returned").
constexpr float kFiltered = 0.5f;
// Of the noise of a sample that is returned. Such errors are not shared, but a share of them is
// taken to be so in S1 and S2 (polar/uncertainty.cpp), where it cancels: 1 would be true of the
// pixel, 1.5 of S1 and S2.
constexpr float kOfReturned = 1.2f;
// From here on residuals are more than the noise is known to be. What they have beyond it is the
// texture that is missing less the noise that was kept, so this much of it is wrong
// (docs/uncertainty.md, "Texture that drowns").
constexpr float kLeastBeyond = 0.05f, kOfBeyond = 1.4f;
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

CellSums means_of(const CellSums& cells, float deviation, int radius) {
  return {gaussian_means(cells.rest, deviation, radius),
          gaussian_means(cells.variance, deviation, radius)};
}

// Of the variance that residuals are compared with, per cell.
struct ResidualShares {
  Image returned, drowned;
};

// Residuals of a wide neighbourhood are sure, those of the near one say where in it.
ResidualShares residual_shares(const CellSums& cells, float sure_share) {
  const CellSums near = means_of(cells, kNearDeviation, kNearRadius),
                 wide = means_of(cells, kWideDeviation, kWideRadius);
  const auto ratio = [](const CellSums& means, int i, int k) {
    return means.variance(i, k) > 0 ? means.rest(i, k) / means.variance(i, k) : 1.0f;
  };
  ResidualShares shares{Image(near.rest.rows(), near.rest.cols()),
                        Image(near.rest.rows(), near.rest.cols())};
  parallel_for(0, near.rest.rows(), kCellRowsOfTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (auto i = static_cast<int>(begin); i < static_cast<int>(end); ++i)
      for (int k = 0; k < near.rest.cols(); ++k) {
        const float here = ratio(near, i, k), around = ratio(wide, i, k);
        shares.returned(i, k) = kOfReturned * std::max(1 - here / kFiltered, 0.0f);
        if (around * sure_share > 1 + kLeastBeyond)
          shares.drowned(i, k) =
              kOfBeyond * std::max(std::min(here, around) - 1 / sure_share, 0.0f);
      }
  });
  return shares;
}

}  // namespace

void state_residual_evidence(const FrameSource& frame, const SampleNoise& noise,
                             const Image& estimate, Image& error) {
  const ResidualShares shares =
      residual_shares(sum_cells(frame, noise, estimate), noise.sure_share);
  parallel_for(0, frame.rows, kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (auto r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < frame.cols; ++c) {
        const float returned = shares.returned(r / kCell, c / kCell),
                    drowned = shares.drowned(r / kCell, c / kCell);
        if (!(returned > 0 || drowned > 0)) continue;
        const auto channel = static_cast<std::size_t>(frame.layout.channel_at(r, c));
        const float value = estimate(r, c);
        if (value > noise.uncut[channel] || noise.hidden(channel, value)) continue;
        const float variance = noise.variance(channel, value);
        error(r, c) = std::max(error(r, c), returned * variance) + drowned * variance;
      }
  });
}

}  // namespace malus::internal
