// Whether the gain is the same all over the frame. The variance of light over its mean is K
// whatever the light; not where a camera multiplies its pixels by a map (flat-field or shading
// correction), nor where halves of a sensor are read out by amplifiers of their own.
#pragma once

#include "malus/calibrate/temporal.h"
#include "malus/noise/calibration.h"

#include <vector>

namespace malus {

/// Sixteenths of the frame at one light level, relative to the whole frame: means over the
/// channels.
struct GainBlocks {
  std::vector<double> gain;         ///< variance above dark over the mean; empty: not known
  std::vector<double> light;        ///< the mean
  std::vector<double> gain_stderr;  ///< of independent pixels
  double mean_dn = 0, light_variance_dn2 = 0;  ///< of the whole frame; the latter above dark
  int frames = 0;
};

/// What the rows of a frame have in common, the same in the dark and in the light.
struct RowsOfFrame {
  double variance_dn2 = 0;
  double groups = 0;  ///< rows with a draw of their own
};

/// flat: before its mean frame is given away. dark_variance_dn2: per channel. step_dn: of the
/// codes. Not known from one frame, where the dark noise is more than a quarter of a channel's
/// variance, and where the noise is narrower than a step. Defects are left out.
GainBlocks gain_blocks(const TemporalAccumulator& flat, const MosaicGeometry& geometry,
                       const std::vector<double>& dark_variance_dn2, double step_dn);

/// Appends a warning where the gain of the sixteenths differs by more than 3 %, and by chance once
/// in 10^7 sessions (χ²). What a bent response makes of uneven light is taken out: it rises with
/// the level. Blocks beside each other hold the same rows, whose noise makes their gains alike.
void warn_of_gain_map(const std::vector<GainBlocks>& levels, const RowsOfFrame& rows,
                      PhysicsCalibration& out);

}  // namespace malus
