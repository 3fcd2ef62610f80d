// The step of residual demosaicking that interpolates the angles.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"
#include "malus/polar/stokes.h"

namespace malus::internal {

struct ResidualAngles {
  StokesPlanes stokes;  ///< full resolution, in the mosaic's unit
  /// 1 where S0 changes with the angles, 0 where the polarization alone does, from the share of the
  /// angles' differences over two pixels that S0 has as well, averaged around a pixel: most of them
  /// at S0's edges, half in noise.
  Image s0_takes_part;
};

/// Of a mosaic of 2x2 blocks of angles with one colour at every pixel: every angle guided by an
/// intensity picture (Demosaicking::kResidual), or interpolated alone where the polarization
/// changes and S0 does not. epsilon: as in guided_upsampled. mean_square: of the whole picture, of
/// which `mosaic` may be a band that begins with a whole cell: kAnglesReach rows inside it and more
/// are those of the whole, to the bit.
ResidualAngles residual_angles(const Image& mosaic, const SensorLayout& layout, double epsilon,
                               double mean_square);

/// Rows: malus_error's 3, then the slopes of guided_upsampled, three windows of 2 lattice rows and
/// one between them, or 14 and 1 of the lattice's place, then the guide's gradients, 4.
inline constexpr int kAnglesReach = 3 + 2 * 7 + 1 + 4;

}  // namespace malus::internal
