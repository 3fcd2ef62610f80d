// What a camera multiplied a channel's whole numbers by after the conversion: digital gain, white
// balance.
#pragma once

#include <vector>

namespace malus {

/// Mean distance, in steps, of the codes in use among the 128 next to each other that hold the most
/// of these pixels of one channel, where next to all are as far apart as rounding the multiples of
/// one number leaves them; else 1, as of pixels too few to use every code (10 for each) or of a few
/// codes (12). step_dn: of all codes (quantization_step); 0: 1.
double digital_gain(const std::vector<float>& pixels_dn, double step_dn);

}  // namespace malus
