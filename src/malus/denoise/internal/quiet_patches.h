// The noise of the smoothest patches of a single picture, told by their own pixels: where letters
// or leaves fill the picture nothing has smooth surroundings, but paper shows between them.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"
#include "malus/noise/variance_curve.h"

#include <vector>

namespace malus {

/// Of patches of about one brightness.
struct QuietPatches {
  std::vector<double> signal_dn;  ///< [channel] of the smooth ones
  double ratio = 0;               ///< of their variance to the given one at these signals
  double relative_error = 0;      ///< of the ratio, one standard error
};

/// dn: mosaic, DN above black, from the first pixel of the cell on. variance: per channel, what the
/// noise's variance is thought to be at a signal. saturated_dn: patches with pixels that are not
/// finite or at least that are left out. dark_dn: patches whose smooth ones are darker are left
/// out.
///
/// Patches of 6x6 pixels of the mosaic fall into two halves, interleaved as a checkerboard is. The
/// noise of one half knows nothing of the other's, but a letter's edge is in both: where one half
/// resembles the mean of its like most, the other is measured (noise_floor.h tells how), and the
/// halves change places. From all patches of a brightness to a thirtieth of them the least clearly
/// lower variance counts. Like the concentration steps of Rousseeuw, Van Driessen, Technometrics
/// 41(3), 1999.
///
/// One per level of brightness, ascending, at most eight; empty where there are fewer than 300
/// patches.
std::vector<QuietPatches> quiet_patches(View<const float> dn, const SensorLayout& layout,
                                        const std::vector<VarianceCurve>& variance,
                                        const std::vector<float>& saturated_dn,
                                        const std::vector<double>& dark_dn);

}  // namespace malus
