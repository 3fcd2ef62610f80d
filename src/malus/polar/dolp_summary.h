// The degree of linear polarization of a whole picture, in a few numbers.
#pragma once

#include "malus/base/estimate.h"
#include "malus/image/view.h"

namespace malus {

struct DolpSummary {
  /// Over the defined pixels. One above 1 counts as 1, as where pictures are compared: it is of
  /// noise, for light has none, and a few of them, where S0 is hardly above 0, would be most of the
  /// mean.
  Estimate<double> mean = Undecided{"not measured"};
  double undefined = 0;  ///< share of all pixels, 0..1
  /// Share of all pixels that have no AoLP: DoLP is undefined, or 0, as it often is of few bits.
  double aolp_undefined = 0;
  double above_one = 0;  ///< share of all pixels, 0..1
};

/// Over the planes of dolp_of (polar/stokes.h), all colours together. The mean is Undecided where
/// no pixel is defined.
DolpSummary summarize_dolp(const Planes& dolp);

}  // namespace malus
