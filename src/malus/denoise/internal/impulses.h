// Single pixels far from their surroundings, as the tails of a heavy read noise make them (random
// telegraph noise; a Tukey-lambda below 0). A filter that knows the noise's variance alone takes
// them for detail: with lambda -0.3 in the dark they were half of its squared error.
#pragma once

#include "malus/denoise/prepared_frame.h"

#include <vector>

namespace malus {

/// Places of the pixels that deviate from the median of their channel's eight nearest by more than
/// a number of deviations, while no pixel beside them does so; the least number, from 6 on, above
/// which the tails of the profile's laws explain half of them. None where they do not: then they
/// are the picture's (stars). Saturated pixels stay.
std::vector<DefectList::Place> find_impulses(const PreparedFrame& frame,
                                             const NoiseProfile& profile);

}  // namespace malus
