// Stokes parameters at every pixel of the sensor instead of one per cell.
#pragma once

#include "malus/base/progress.h"
#include "malus/image/layout.h"
#include "malus/image/view.h"
#include "malus/polar/stokes.h"

#include <array>
#include <string_view>

namespace malus {

enum class Demosaicking {
  /// Every colour and angle alone, linear between its own samples. For any polarized layout.
  kBilinear,
  /// Edge-aware residual interpolation: colours first, inside the Bayer picture of each angle
  /// (Hamilton-Adams green with directional weights, residual interpolation of red and blue: Kiku
  /// et al., ICIP 2013), then angles, guided by an intensity picture averaged over the 2x2 block on
  /// the smooth side of edges (after Morimatsu, Monno, Tanaka, Okutomi, "Monochrome and color
  /// polarization demosaicking using edge-aware residual interpolation", ICIP 2020). Where the
  /// polarization changes and S0 does not, angles are interpolated without the guide. S1 and S2 of
  /// colour sensors are smoothed by [1 2 1], as their samples are four pixels apart. Nothing falls
  /// far below all samples around it, so that S0 is positive where all samples are.
  kResidual,
};

inline constexpr std::array<std::string_view, 2> kDemosaickingNames = {"bilinear", "residual"};

/// Residual interpolation needs 2x2 blocks of one colour with the four angles in one order, and
/// blocks that are all of one colour or form a Bayer pattern.
bool supports_residual(const SensorLayout& layout);

/// mosaic: DN above black. Result: planes of the mosaic's size, "R", "G", "B" (G from both greens)
/// or "" for mono. Pixels that hold no light (NaN, infinite, 1e15 DN or more) are filled from
/// their neighbours first, so that others stay as they are; at their own places the result is NaN.
/// All of it is NaN where a channel has no other pixels. Throws InputError, which names `source`,
/// when the layout is not polarized or the mosaic is smaller than two cells; and when the method
/// does not support the layout. Throws Cancelled where progress asks for a stop.
StokesPicture demosaick(View<const float> mosaic, const SensorLayout& layout,
                        Demosaicking method = Demosaicking::kResidual,
                        const std::string& source = "demosaicking",
                        const Progress& progress = silent_progress());

/// Two greens on one diagonal of 2x2 sites, red and blue on the other, no polarizers.
bool is_bayer(const SensorLayout& layout);

/// R, G, B planes of a Bayer mosaic's size in its unit, colours as in kResidual. Pixels that hold
/// no light are filled first, with 0 where a channel has no others: outputs are finite. Throws
/// InputError where the layout is no Bayer pattern or the mosaic smaller than two cells.
Planes demosaick_bayer(View<const float> mosaic, const SensorLayout& layout);

}  // namespace malus
