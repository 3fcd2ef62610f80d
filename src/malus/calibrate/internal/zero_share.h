// How many dark pixels are at the code where a camera cuts its noise off: 0, or its lowest one.
#pragma once

#include "malus/base/index.h"
#include "malus/calibrate/geometry.h"
#include "malus/calibrate/internal/lowest_codes.h"
#include "malus/image/view.h"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

namespace malus {

/// Of the frames that were added, per channel. zero_dn: what code 0 is in them (moved_zero_dn). At
/// it no share where any pixel is below: black is subtracted already, and nothing is cut off there.
class ZeroShare {
 public:
  /// Of dark frames, whose floor floors_dn() finds. step_dn: of the codes; 0: none.
  ZeroShare(const MosaicGeometry& geometry, std::vector<double> zero_dn, double step_dn)
      : geometry_(geometry),
        zero_dn_(std::move(zero_dn)),
        step_dn_(step_dn),
        lowest_(as_index(geometry.channels())),
        zeros_(lowest_.size(), 0) {}
  /// Of other frames, at the floor that dark ones have.
  ZeroShare(const MosaicGeometry& geometry, std::vector<double> zero_dn,
            std::vector<double> floors_dn)
      : geometry_(geometry),
        zero_dn_(std::move(zero_dn)),
        floors_dn_(std::move(floors_dn)),
        zeros_(as_index(geometry.channels()), 0) {}
  void add(View<const float> dn) {
    for (int r = 0; r < geometry_.rows(); ++r)
      for (int c = 0; c < geometry_.cols(); ++c) {
        const auto channel = as_index(geometry_.channel(r, c));
        const float value = dn(r, c);
        if (value < zero_dn_[channel]) below_zero_ = true;
        if (value <= (floors_dn_.empty() ? zero_dn_ : floors_dn_)[channel]) ++zeros_[channel];
        if (!lowest_.empty()) lowest_[channel].add(value);
      }
    ++frames_;
  }
  /// Per channel. The converter's lowest code is one for all: a channel that ends there too takes
  /// it from one that shows it.
  std::vector<double> floors_dn() const {
    if (!floors_dn_.empty() || lowest_.empty()) return floors_dn_;
    std::vector<double> out = zero_dn_, piled_codes;
    const auto lowest_code = [&](std::size_t c) { return lowest_[c].lowest_dn() - zero_dn_[c]; };
    for (std::size_t c = 0; c < out.size(); ++c)
      if (piled(c)) {
        out[c] = lowest_[c].lowest_dn();
        piled_codes.push_back(lowest_code(c));
      }
    for (std::size_t c = 0; c < out.size(); ++c)
      if (lowest_[c].count() > 0 &&
          std::find(piled_codes.begin(), piled_codes.end(), lowest_code(c)) != piled_codes.end())
        out[c] = lowest_[c].lowest_dn();
    return out;
  }
  std::vector<double> shares() const {
    const std::vector<double> floors = floors_dn();
    std::vector<double> out(zeros_.size(), 0.0);
    if (frames_ == 0) return out;
    for (std::size_t c = 0; c < out.size(); ++c) {
      const bool at_zero = floors[c] == zero_dn_[c];
      if (at_zero && below_zero_) continue;
      const std::int64_t count = at_zero || lowest_.empty() ? zeros_[c] : lowest_[c].at_lowest();
      out[c] = static_cast<double>(count) / pixels(c);
    }
    return out;
  }

 private:
  double pixels(std::size_t c) const {
    return static_cast<double>(geometry_.channel_pixels(static_cast<int>(c))) * frames_;
  }
  bool piled(std::size_t c) const {
    return step_dn_ > 0 && lowest_[c].is_pile(step_dn_, pixels(c));
  }

  MosaicGeometry geometry_;
  std::vector<double> zero_dn_;
  double step_dn_ = 0;
  std::vector<double> floors_dn_;
  std::vector<LowestCodes> lowest_;
  std::vector<std::int64_t> zeros_;
  bool below_zero_ = false;
  int frames_ = 0;
};

}  // namespace malus
