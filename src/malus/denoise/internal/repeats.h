// After which steps a picture comes again: fabrics, grids, rows of windows, print. The mosaic
// filter looks for like blocks nearby and, more widely, at every second cell; the copies of what
// repeats lie where its period says. Autocovariance over a region tells that period where light is
// so low that no single block does.
#pragma once

#include "malus/denoise/internal/stack_stage.h"

#include <algorithm>
#include <cstdlib>
#include <vector>

namespace malus {

struct FrameSource;

namespace internal {

/// Mosaic pixels, whole cells.
struct RepeatStep {
  int rows, cols;
};
inline constexpr int kMostRepeatSteps = 48;  ///< of a region

/// The steps of every region of a frame, both ways; the nearest ones where there are many.
class Repeats {
 public:
  static constexpr int kRegionCells = 128;

  Repeats() : Repeats(1, 1) {}
  /// None yet, in so many regions.
  Repeats(int down, int across)
      : down_(down), across_(across), steps_(static_cast<std::size_t>(down * across)) {}

  int down() const { return down_; }
  int across() const { return across_; }
  std::vector<RepeatStep>& of_region(int i, int k) { return steps_[index(i, k)]; }
  /// Around a pixel of the frame, or beyond its border.
  const std::vector<RepeatStep>& at(int row, int col) const {
    constexpr int kRegion = kRegionCells * kCell;
    const int i = std::clamp(row / kRegion, 0, down_ - 1),
              k = std::clamp(col / kRegion, 0, across_ - 1);
    return steps_[index(i, k)];
  }
  /// The farthest step in rows or columns [mosaic pixels]; 0 where nothing repeats.
  int reach() const {
    int reach = 0;
    for (const auto& region : steps_)
      for (const RepeatStep& step : region)
        reach = std::max({reach, std::abs(step.rows), std::abs(step.cols)});
    return reach;
  }
  /// Those that `keep` is true of.
  template <class Keep>
  Repeats where(const Keep& keep) const {
    Repeats kept = *this;
    for (auto& region : kept.steps_)
      std::erase_if(region, [&](const RepeatStep& step) { return !keep(step); });
    return kept;
  }

 private:
  std::size_t index(int i, int k) const { return static_cast<std::size_t>(i * across_ + k); }

  int down_, across_;
  std::vector<std::vector<RepeatStep>> steps_;
};

/// Steps beyond 8 cells, of a frame whose noise has deviation 1.
Repeats find_repeats(const FrameSource& frame);

}  // namespace internal
}  // namespace malus
