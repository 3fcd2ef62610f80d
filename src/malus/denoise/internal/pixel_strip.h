// A strip of a frame and what a filter made of it, in cells and in groups of 2x2 pixels: what
// joint_bilateral.cpp changes and kept_noise.cpp measures. Not installed.
#pragma once

#include "malus/denoise/internal/frame_filter.h"
#include "malus/image/layout.h"

#include <algorithm>
#include <cstddef>
#include <functional>
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

/// Of stabilised samples.
struct SampleNoise {
  std::vector<float> uncut;  ///< per channel: the noise is whole up to there; white cuts off others
  /// (channel, estimate): the variance that it has at least there, 1 where it is known.
  std::function<float(std::size_t, float)> variance;
  /// (channel, estimate): the converter's step hides it there. Equal codes are no equal light, and
  /// residuals do not tell of errors; none: nowhere.
  std::function<bool(std::size_t, float)> hides = {};
  /// Of what is told of the noise, what `variance` counts on: less where the frame shows less; 0
  /// where the frame itself tells, and took texture as fine as the pixels for noise.
  float sure_share = 1;
  bool hidden(std::size_t channel, float mean) const { return hides && hides(channel, mean); }
};

/// With its surroundings above and below. Its rows begin at a whole cell.
struct PixelStrip {
  const SensorLayout& layout;
  Image samples, estimate;   ///< of one size
  Image cell_error;          ///< expected squared error of the estimate, means over the cells
  const SampleNoise& noise;  ///< of the samples
  int first_row;             ///< of the frame

  int rows() const { return estimate.rows(); }
  int cols() const { return estimate.cols(); }
  /// Where white cuts the noise off the residual is less, whatever the estimate keeps.
  bool is_cut_off(int r, int c) const { return estimate(r, c) > noise.uncut[channel_at(r, c)]; }
  float variance(int r, int c) const { return noise.variance(channel_at(r, c), estimate(r, c)); }
  bool is_hidden(int r, int c) const { return noise.hidden(channel_at(r, c), estimate(r, c)); }
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

 private:
  std::size_t channel_at(int r, int c) const {
    return static_cast<std::size_t>(layout.channel_at(first_row + r, c));
  }
};

}  // namespace malus::internal
