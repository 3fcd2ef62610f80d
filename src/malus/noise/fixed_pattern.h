// What of a sensor's frames stays the same from one to the next.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/image/view.h"

#include <memory>

namespace malus {

struct NoiseModel;

/// Maps of the whole sensor at one gain; either may be empty.
struct FixedPattern {
  Image dark_dn;   ///< mosaic: dark signal above the channel's mean; 0 at defects
  Image response;  ///< mosaic: response to light relative to the neighbours'; 1 at defects
};

/// The maps of the measured gain nearest to `gain` (of the first one where no gain is named), each
/// of the nearest that has it; null where the model holds none. Of ordinary pixels their sampling
/// error's share, as DSNU and PRNU tell it, is taken away (Wiener), of outliers less. Contract: no
/// contradiction_in(model).
std::shared_ptr<const FixedPattern> fixed_pattern_at(const NoiseModel& model,
                                                     const GainSetting& gain);

/// Values in the maps of all gains; and what forgets the maps, where no frame will need them.
double map_values(const NoiseModel& model);
void drop_maps(NoiseModel& model);

}  // namespace malus
