// Noise that the pixels of a row share.
#pragma once

#include <vector>

namespace malus {

/// Offsets of a mosaic's row groups, which count from its first row: those of its channels in one
/// group are one draw, times each channel's own deviation.
struct RowOffsets {
  std::vector<double> sd_dn;        ///< one per channel of the layout [DN]; empty: none
  int group_rows = 1;               ///< mosaic rows that share one draw
  std::vector<double> correlation;  ///< of draws one group apart, two, ...; none beyond
};

}  // namespace malus
