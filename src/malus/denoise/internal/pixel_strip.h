// A strip of a frame and what a filter made of it, in cells and in groups of 2x2 pixels: what
// joint_bilateral.cpp changes and kept_noise.cpp measures. Not installed.
#pragma once

#include "malus/denoise/internal/frame_filter.h"
#include "malus/image/layout.h"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace malus::internal {

/// 2x2 pixels, or what of them lies inside.
struct PixelGroup {
  int row, col, row_end, col_end;
  int size() const { return (row_end - row) * (col_end - col); }
  template <class Value>
  float mean(Value value) const {
    float sum = 0;
    for (int r = row; r < row_end; ++r)
      for (int c = col; c < col_end; ++c) sum += value(r, c);
    return sum / static_cast<float>(size());
  }
};

/// With its surroundings above and below. Its rows begin at a whole cell.
struct PixelStrip {
  const SensorLayout& layout;
  Image samples, estimate;          ///< of one size; the samples' noise has deviation 1
  const std::vector<float>& uncut;  ///< per channel: the noise is whole up to there
  float sure_noise;                 ///< the variance that the noise has at least
  int first_row;                    ///< of the frame

  int rows() const { return estimate.rows(); }
  int cols() const { return estimate.cols(); }
  /// Where white cuts the noise off the residual is less, whatever the estimate keeps.
  bool is_cut_off(int r, int c) const {
    const auto channel = static_cast<std::size_t>(layout.channel_at(first_row + r, c));
    return estimate(r, c) > uncut[channel];
  }
  /// One value per cell, 0.
  Image cell_map() const { return Image(cell_count(rows()), cell_count(cols())); }
  int pixels_of(int i, int k) const {
    return std::min(kCell, rows() - i * kCell) * std::min(kCell, cols() - k * kCell);
  }
  /// use(PixelGroup) for those of the cell.
  template <class Use>
  void for_groups(int i, int k, Use use) const {
    for (int r = i * kCell; r < std::min((i + 1) * kCell, rows()); r += 2)
      for (int c = k * kCell; c < std::min((k + 1) * kCell, cols()); c += 2)
        use(PixelGroup{r, c, std::min(r + 2, rows()), std::min(c + 2, cols())});
  }
};

}  // namespace malus::internal
