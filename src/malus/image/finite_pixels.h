// What the pixels say that are numbers.
#pragma once

#include "malus/image/view.h"

namespace malus {

/// Mean of the finite pixels; 0 where there is none.
double finite_mean(View<const float> pixels);

/// The largest finite pixel, and not below 0; 0 where there is none.
double finite_largest(View<const float> pixels);

}  // namespace malus
