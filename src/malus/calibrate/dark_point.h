// The point without light of a photon-transfer line.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/calibrate/photon_transfer.h"
#include "malus/noise/calibration.h"

namespace malus {

/// Of one channel. variance_dn2: temporal, of the bias frames, whose row noise and residuals `bias`
/// holds.
DarkPoint dark_point(int channel, const MosaicGeometry& geometry, double variance_dn2,
                     const PhysicsCalibration& bias);

}  // namespace malus
