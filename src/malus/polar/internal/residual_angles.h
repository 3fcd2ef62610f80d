// The step of residual demosaicking that interpolates the angles.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"
#include "malus/polar/stokes.h"

namespace malus::internal {

/// Full-resolution Stokes planes of a mosaic of 2x2 blocks of angles with one colour at every
/// pixel, in its unit: every angle guided by an intensity picture (Demosaicking::kResidual), or
/// interpolated alone where the polarization changes and S0 does not. epsilon: as in
/// guided_upsampled.
StokesPlanes residual_angles(const Image& mosaic, const SensorLayout& layout, double epsilon);

}  // namespace malus::internal
