// What one gain's flat frames tell: K by photon transfer, PRNU (000, 3.2).
#pragma once

#include "malus/calibrate/internal/bias_calibration.h"
#include "malus/calibrate/internal/gain_run.h"

namespace malus {

/// Fills K, its intercepts, transfer, flat_levels, prnu, prnu_map and warnings of `out`. Contract:
/// measure_bias filled it, of two bias frames or more. Each flat set of the run is one light level.
/// `dark`, of the bias frames, serves flats that have no dark set of their own exposure.
void measure_flats(const GainRun& run, const DarkPass& dark, PhysicsCalibration& out);

}  // namespace malus
