// Whether a clean picture can be what a camera counts: noise is drawn of light in DN, and a picture
// from 0 to 1, or of 16 bits for a camera of 12, gets noise that has nothing to do with it.
#pragma once

#include "malus/image/view.h"
#include "malus/noise/model.h"

#include <string>

namespace malus {

/// A clean picture [DN above black] that is in another scale than white_dn, white above black: none
/// of its pixels is brighter than 1 DN (and they are not all alike), or more than a tenth is
/// brighter than white. One sentence; empty where neither is so, and where white_dn is not above 1.
/// Pixels that are not finite do not count. Looks at about a thousand pixels, and at all where
/// these are suspicious, so it costs nothing beside the noise.
std::string light_scale_complaint(View<const float> clean_dn, double white_dn);

/// That white of a model's camera; 0 where the model tells none.
double white_of_light_dn(const NoiseModel& model);

}  // namespace malus
