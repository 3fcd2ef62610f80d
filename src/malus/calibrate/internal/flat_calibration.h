// What one gain's flat frames tell: K by photon transfer, PRNU (000, 3.2).
#pragma once

#include "malus/calibrate/frame_set.h"
#include "malus/calibrate/internal/bias_calibration.h"

#include <vector>

namespace malus {

/// Fills K, its intercepts, transfer, flat_levels, prnu, prnu_map and warnings of `out`. Contract:
/// its sigma_row and dark_shading_dn, which measure_bias fills, are there. flats: sets of one gain,
/// one light level each. darks: sets of dark frames of the flats' own exposures (may be empty);
/// `dark`, of the set `bias`, serves the others.
void measure_flats(const std::vector<const FrameSet*>& flats,
                   const std::vector<const FrameSet*>& darks, const FrameSet& bias,
                   const RawFrame& first, const DarkPass& dark, int row_group,
                   const CalibrationSettings& settings, Progress& progress,
                   PhysicsCalibration& out);

}  // namespace malus
