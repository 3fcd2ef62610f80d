// Where a sensor saturates below the converter's white level: by EMVA 1288 (release 4.0 linear,
// "saturation capacity") at the maximum of the temporal variance.
#pragma once

#include "malus/calibrate/internal/photon_transfer.h"

#include <vector>

namespace malus {

/// Per level, whether it lies past that maximum. Levels of two frames or more count, save those at
/// white; all brighter ones must lie past it, too. Such a level's variance is below what the gain
/// of the darker ones gives by five standard errors, and it is either below the largest of theirs,
/// by four, or by more than a quarter of what is expected (a smooth droop takes less). At least two
/// levels must lie below it, and no brighter level's variance above its own, by four: of heavy
/// tails a single value makes the first levels loud and all others look short of their gain.
std::vector<bool> saturated_levels(const std::vector<TransferLevel>& levels, const DarkPoint& dark);

}  // namespace malus
