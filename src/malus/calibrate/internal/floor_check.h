// Whether the lowest code of dark frames is where their noise is cut off, as it seemed.
#pragma once

#include "malus/calibrate/internal/bias_calibration.h"
#include "malus/calibrate/internal/dark_codes.h"
#include "malus/calibrate/internal/gain_run.h"
#include "malus/image/view.h"

#include <optional>
#include <vector>

namespace malus {

/// Of counts of successive codes, the lowest first: whether those above hold what a cut at the
/// lowest code has taken below it, a fiftieth of what lies there at least. Read noise is symmetric,
/// so as much lies beyond the mirror image of that code's lower edge about the median. True where
/// the lowest code holds half of all, which leaves no median.
bool reach_beyond_mirror(const std::vector<double>& counts);

/// A second look at floors above code 0. The counts of narrow noise with light tails fall so fast
/// from code to code that the lowest one looks like a pile (LowestCodes::is_pile), though nothing
/// lies below it.
class FloorCheck {
 public:
  /// run and dark (of which measure_dark has filled the floors) must outlive this.
  FloorCheck(const GainRun& run, DarkPass& dark);
  /// Every dark frame.
  void add(View<const float> dn) {
    if (codes_) codes_->add(dn);
  }
  /// Takes floors back that are none: floor_dn, floor_code_dn and zero_share of `dark`.
  void settle();

 private:
  bool is_raised(std::size_t channel) const {
    return dark_.floor_dn[channel] != run_.zero_dn()[channel];
  }
  const GainRun& run_;
  DarkPass& dark_;
  std::optional<DarkCodes> codes_;  ///< where there is such a floor
};

}  // namespace malus
