// Dark current that differs from pixel to pixel, in flats without dark frames of their own
// exposure: it looks like response. Levels of unlike exposure for their light tell the two apart.
#pragma once

#include "malus/calibrate/internal/response.h"
#include "malus/noise/calibration.h"

#include <vector>

namespace malus {

/// One flat level of the response.
struct ResponseLevel {
  double exposure_s = 0;
  /// Exposure less that of the dark frames that were subtracted, below 0 of shorter flats; 0:
  /// theirs was the same, or it is not known.
  double darkless_s = 0;
  /// Mean over the channels of the square of that difference over the signal: what an unlike dark
  /// current of 1 DN/s adds to prnu2.
  double s2_per_dn2 = 0;
  /// Square of the PRNU of this level alone, of all channels; NaN where it shows that of some.
  double prnu2 = 0, prnu2_stderr = 0;
};

/// Takes from prnu, where the levels tell of it clearly, what dark current makes of it, and appends
/// a warning; another one where they tell nothing, flats have no dark frames of their exposure, and
/// dark current may be a part of PRNU: the exposures differ by a second or more, or by 0.3 s and so
/// much for the light that 50 e-/s make PRNU (0.3 % at least, 1 % at most) 5 % too large. Reads K.
void take_dark_current(const std::vector<ResponseLevel>& levels, Response& response,
                       PhysicsCalibration& out);

}  // namespace malus
