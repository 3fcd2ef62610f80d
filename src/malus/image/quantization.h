// What a converter's whole numbers are multiples of.
#pragma once

#include "malus/image/view.h"

namespace malus {

/// The converter's step: greatest common divisor of the differences between a frame's values (16
/// for 12 bits stored in the upper part of 16); 0 for fractional values and where all are equal.
double quantization_step(View<const float> dn);

}  // namespace malus
