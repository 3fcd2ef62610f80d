// What of a sensor's map is smooth in both directions, as a glow is.
#pragma once

#include "malus/image/view.h"

#include <vector>

namespace malus {

/// Of every channel the medians of blocks of about 16x16 of its pixels, and lines between their
/// middles. A median of values that differ by chance alone has kOfMedian of their variance.
class SmoothMap {
 public:
  static constexpr int kBlock = 16;
  static constexpr double kOfMedian = 1.571 / (kBlock * kBlock);

  /// A channel is a place in cells of so many rows and columns. middle: values are counted from it.
  SmoothMap(View<const float> map, int cell_rows, int cell_cols, double middle);
  /// Whether the blocks differ by more than the variance that chance gives one; per channel.
  bool differs(const std::vector<double>& chance_variance) const;
  /// From the least to the largest of a channel's blocks.
  double span(int channel) const;
  /// Above the middle, for every pixel.
  Image values() const;

 private:
  struct Grid {
    int first_row = 0, first_col = 0, rows = 0, cols = 0;  ///< of the channel's pixels
    Image medians;                                         ///< above the middle
  };
  int rows_, cols_, cell_rows_, cell_cols_;
  std::vector<Grid> channels_;
};

}  // namespace malus
