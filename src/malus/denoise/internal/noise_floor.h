// How much of what looks like the noise of a single picture is noise: whatever the picture shows,
// some combination of neighbouring pixels hardly varies with it, and noise varies in all of them.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"
#include "malus/noise/variance_curve.h"

#include <vector>

namespace malus {

/// Of patches of about one brightness.
struct NoiseFloor {
  double signal_dn = 0;       ///< their mean signal
  double ratio = 0;           ///< of the noise's variance to the given one
  double relative_error = 0;  ///< of the ratio, one standard error
};

/// dn: mosaic, DN above black, from the first pixel of the cell on. variance: what the noise's
/// variance is thought to be at a signal; a factor that is wrong in all channels does no harm.
/// saturated_dn: patches with pixels that are not finite or at least that are left
/// out, and so are those where variance is no more than least_dn2: noise of less than half a step
/// of the converter leaves patches of equal pixels.
///
/// Patches of 6x6 pixels of the mosaic, divided by the deviations that variance gives for their
/// surroundings; those beside edges are left out, where the surroundings are of another brightness.
/// The directions in which one half of the patches varies least (the four smallest
/// principal components) are measured on the other half, by a median: no direction is chosen by the
/// noise that it is measured with. Of all patches, of the two fifths and of the fifth in the
/// smoothest surroundings (of the surroundings alone, or noise would choose) the least counts,
/// where these are clearly smoother. Principal components: Pyatykh, Hesser, Zheng, IEEE TIP 22(2),
/// 2013; Chen, Zhu, Heng, ICCV 2015; halves, surroundings and mosaics are this project's.
///
/// One per level of brightness, ascending, at most eight, fewer for small pictures and those of
/// nearly one brightness; empty where fewer than 300 patches are left. Texture as fine as the
/// pixels is not told from noise, and noise that neighbouring pixels share (smoothed or enlarged
/// pictures) comes out too low. Memory: some 30 MiB, whatever the frame.
std::vector<NoiseFloor> noise_floor(View<const float> dn, const SensorLayout& layout,
                                    const std::vector<VarianceCurve>& variance,
                                    const std::vector<float>& saturated_dn,
                                    const std::vector<double>& dark_dn = {});

}  // namespace malus
