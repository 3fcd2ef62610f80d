// Noise before the converter rounds it, behind how often each code occurs.
#pragma once

#include "malus/noise/calibration.h"

#include <vector>

namespace malus {

/// Where inside the codes their probability lies: the cumulative distribution is known at the
/// codes' boundaries, and between them its normal quantile is taken for a line, as it is of normal
/// noise.
class WithinCodes {
 public:
  /// codes: probabilities of neighbouring codes, which add to one.
  explicit WithinCodes(const std::vector<double>& codes);
  /// Of a code's own probability, what lies between two places in it, from 0, its lower boundary,
  /// to 1.
  double share(std::size_t code, double from, double to) const;

 private:
  std::vector<double> quantile_;  // at the boundaries
};

/// The channel with its level of signal zero, which calibrations until 2026-11-28 kept even inside
/// each code, smooth inside them, in the bins that it has: every code stays as probable. One that
/// is smooth stays as it is but for what WithinCodes rounds. step_dn: of the converter; 0: nothing
/// is done.
NonparametricChannel smooth_inside_codes(NonparametricChannel channel, double black_dn,
                                         double step_dn);

}  // namespace malus
