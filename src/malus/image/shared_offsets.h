// Noise that the pixels of a row or of a column share.
#pragma once

#include <vector>

namespace malus {

/// Offsets of a mosaic's lines, all rows or all columns, in groups that count from its first line:
/// those of its channels in one group are one draw, times each channel's own deviation.
struct LineOffsets {
  std::vector<double> sd_dn;        ///< one per channel of the layout [DN]; empty: none
  int group_lines = 1;              ///< mosaic lines that share one draw
  std::vector<double> correlation;  ///< of draws one group apart, two, ...; none beyond
};

/// Independent of each other.
struct SharedOffsets {
  LineOffsets rows, columns;
};

}  // namespace malus
