// Which pixels of a frame are at white. Judged before anything is corrected: a correction may lift
// a pixel above white that is not saturated.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/raw_frame.h"
#include "malus/image/view.h"

#include <vector>

namespace malus {

/// Per channel, the largest value where enough pixels share it to show that they were clipped
/// there; infinite where none were. Noise ends in a tail: of pixels that are not clipped the
/// largest value has fewer than the one below it.
std::vector<float> piled_up_dn(View<const float> dn, const SensorLayout& layout);

/// Whether the frame's pixels show that its white is where they are clipped, told or not: all
/// channels that pile up do so there.
bool clips_at_white(const RawFrame& frame);

class SaturatedPixels {
 public:
  SaturatedPixels() = default;
  /// Those at least as bright as saturated_dn, one per channel.
  SaturatedPixels(View<const float> dn, const SensorLayout& layout,
                  const std::vector<float>& saturated_dn)
      : cols_(dn.cols()), is_(index(dn.rows(), 0)) {
    for (int r = 0; r < dn.rows(); ++r)
      for (int c = 0; c < dn.cols(); ++c)
        is_[index(r, c)] =
            dn(r, c) >= saturated_dn[static_cast<std::size_t>(layout.channel_at(r, c))];
  }
  bool operator()(int row, int col) const { return is_[index(row, col)]; }

 private:
  std::size_t index(int row, int col) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(cols_) +
           static_cast<std::size_t>(col);
  }
  int cols_ = 0;
  std::vector<bool> is_;
};

}  // namespace malus
