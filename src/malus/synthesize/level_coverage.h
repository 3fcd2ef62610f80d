// How much of a picture a non-parametric model was calibrated for: what lies outside its levels
// gets other noise than was measured, which users have to hear of.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"
#include "malus/noise/level_noise.h"

#include <cstdint>
#include <string>
#include <vector>

namespace malus {

/// Finite pixels, and those below the darkest and above the brightest level of their channel.
/// Signals of no light are not below a dark level of 0.
struct LevelCoverage {
  std::int64_t pixels = 0, below = 0, above = 0;
  LevelRange range;  ///< what all channels have

  /// Adds another picture's.
  void add(const LevelCoverage& other);
  /// One sentence on the shares outside and what they get; empty where all pixels lie inside.
  std::string complaint() const;
};

/// ranges: one per channel of the layout; row0, col0 place the view in the mosaic.
LevelCoverage level_coverage(const SensorLayout& layout, const std::vector<LevelRange>& ranges,
                             View<const float> signal_dn, int row0 = 0, int col0 = 0);

}  // namespace malus
