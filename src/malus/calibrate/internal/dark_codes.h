// How often each code of an integer converter occurs in the dark.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/calibrate/level_histograms.h"
#include "malus/image/view.h"

#include <cstdint>
#include <vector>

namespace malus {

/// Histogram of the codes of dark frames, per channel. The lattice is kept as it is: a converter's
/// unequal steps show in it, and would be washed out by subtracting anything that is not an
/// integer. It holds the codes between the lowest and the highest that occur, whatever white is
/// declared.
class DarkCodes {
 public:
  /// Any frame tells where the codes' lattice of step_dn (above zero) begins.
  DarkCodes(const MosaicGeometry& geometry, View<const float> frame_dn, double step_dn);
  void add(View<const float> dn);
  int frames() const { return frames_; }
  CodeGrid grid(double black_dn) const { return {step_dn_, origin_dn_ - black_dn}; }
  /// Counts from the first code that occurred to the last.
  std::vector<double> occurred(int channel, std::int64_t& first_code) const;

 private:
  struct Codes {
    std::ptrdiff_t first = 0;  ///< where black is subtracted codes are negative, too
    std::vector<double> counts;
    double& at(std::ptrdiff_t code);
  };
  const MosaicGeometry& geometry_;
  double step_dn_, origin_dn_;
  int frames_ = 0;
  std::vector<Codes> codes_;  ///< by channel
};

}  // namespace malus
