// How many pixels are at DN 0, where a camera may cut its dark noise off.
#pragma once

#include "malus/base/index.h"
#include "malus/calibrate/geometry.h"
#include "malus/image/view.h"

#include <vector>

namespace malus {

/// Of the frames that were added, per channel. 0 where any pixel is below 0: black is subtracted
/// already, and nothing is cut off there.
class ZeroShare {
 public:
  explicit ZeroShare(const MosaicGeometry& geometry)
      : geometry_(geometry), zeros_(as_index(geometry.channels()), 0.0) {}
  void add(View<const float> dn) {
    for (int r = 0; r < geometry_.rows(); ++r)
      for (int c = 0; c < geometry_.cols(); ++c) {
        if (dn(r, c) < 0.0F) below_zero_ = true;
        if (dn(r, c) <= 0.0F) zeros_[as_index(geometry_.channel(r, c))] += 1.0;
      }
    ++frames_;
  }
  std::vector<double> shares() const {
    std::vector<double> out(zeros_.size(), 0.0);
    if (below_zero_ || frames_ == 0) return out;
    for (int c = 0; c < geometry_.channels(); ++c)
      out[as_index(c)] =
          zeros_[as_index(c)] / (static_cast<double>(geometry_.channel_pixels(c)) * frames_);
    return out;
  }

 private:
  MosaicGeometry geometry_;
  std::vector<double> zeros_;
  bool below_zero_ = false;
  int frames_ = 0;
};

}  // namespace malus
