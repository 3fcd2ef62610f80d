// Histograms of noisy - clean per channel and signal level (001, S1-S2).
#pragma once

#include "malus/noise/calibration.h"

#include <cstdint>
#include <string>
#include <vector>

namespace malus {

/// Bin edges fine around zero, where dark levels need them, and wider by a constant factor
/// outwards, where only bright levels reach: edge(t) = w/a sinh(a t). The bins near zero are at
/// most a sixth of the smallest deviation wide; the outermost edges lie at seven of the largest, or
/// as near as `bins` uniform ones allow.
std::vector<double> noise_bin_edges(double smallest_sd_dn, double largest_sd_dn, int bins);

/// One channel's histograms, by level = nearest multiple of the step.
class LevelHistograms {
 public:
  LevelHistograms() = default;
  LevelHistograms(std::vector<double> edges_dn, double step_dn, double range_dn);

  /// Signals outside 0..range count at the nearest level; noise outside the edges counts in the
  /// last bins, whose edges move out to hold it.
  void add(double signal_dn, double noise_dn);

  struct Result {
    NonparametricChannel channel;
    int refused_levels = 0;
    std::int64_t refused_samples = 0;
  };
  /// Levels with at least wanted samples as they are; those with fewer borrow from up to two levels
  /// on both sides, and are refused when that does not give a tenth of what is wanted. A level's
  /// centre is the mean signal of its samples, borrowed ones included.
  Result result(std::int64_t wanted) const;

 private:
  struct Level {
    std::int64_t count = 0;
    double signal_sum = 0;
  };
  std::vector<double> edges_;
  std::vector<Level> levels_;
  std::vector<std::uint32_t> counts_;  ///< [level][bin]
  double step_dn_ = 1, widest_ = 0;
};

}  // namespace malus
