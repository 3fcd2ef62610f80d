// What a denoised frame's pixels could not tell: lines for people, from what denoise_frame counted.
#pragma once

#include "malus/denoise/denoiser.h"

#include <cstdint>
#include <string>
#include <vector>

namespace malus {

/// Of pixels that are not numbers, saturated ones where they are many, and dark ones that the
/// camera cut off at 0. Without the frame's name. Contract: dn_above_black has the frame's
/// size; or it is empty, and a network made a picture of so many pixels, all of them numbers.
std::vector<std::string> frame_complaints(const Denoised& result, std::int64_t of_picture = 0);

}  // namespace malus
