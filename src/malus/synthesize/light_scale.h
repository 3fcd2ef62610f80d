// Whether a clean picture can be what a camera counts: noise is drawn of light in DN, and a picture
// from 0 to 1, or of 16 bits for a camera of 12, gets noise that has nothing to do with it; and
// whether a picture of floats is one from 0 to 1.
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

/// The same of the light of a picture, of which white is 1 (linear_light), where its pixels are
/// floats (bits 0), which have no other white: more than a tenth of it is brighter, and an exposure
/// that multiplies it does not make up for that. Without the picture's name.
std::string picture_scale_complaint(const Planes& light, int bits, double exposure);

/// That white of a model's camera; 0 where the model tells none.
double white_of_light_dn(const NoiseModel& model);

}  // namespace malus
