// Whether what looks like the noise of a single picture is texture: noise is drawn for every
// channel apart, while neighbouring pixels of different channels see the same detail of the scene.
#pragma once

#include "malus/image/view.h"

#include <vector>

namespace malus {

/// Share (0 to 1) of the power of the diagonal second differences of 2x2 pixels that the other
/// channels' differences at the same place predict by a linear fit, mean over the channels, chance
/// taken off; over the 40 % of blocks of 8x8 pixels of a channel that are smoothest at a coarser
/// scale. 0 for a single channel and for fewer than 64 blocks. planes: DN above black; blocks with
/// pixels that are not finite or at least their channel's saturated_dn are left out. Detail finer
/// than the channels are apart is not shared and not seen.
double shared_detail(const Planes& planes, const std::vector<float>& saturated_dn);

}  // namespace malus
