// What of the variance that a picture's levels show is the picture's texture, not noise. Of
// estimate_profile.
#pragma once

#include "malus/denoise/internal/variance_lines.h"
#include "malus/image/layout.h"
#include "malus/image/view.h"

#include <vector>

namespace malus::internal {

/// Levels become what the floors (noise_floor.h) leave of the lines through them: never more, for
/// texture that no direction escapes lifts the floors too. How channels differ is kept as far as
/// there is no texture: its size in one channel says nothing of the noise there. lines: settled
/// before and after; untouched where there is little texture. Then smooth patches between texture
/// (quiet_patches.h) are heard if wanted, where they clearly tell of less noise. dn: mosaic above
/// black.
/// Returns the share of the variance that was texture.
double take_texture_off(const Image& dn, const SensorLayout& layout,
                        const std::vector<float>& saturated_dn, bool hear_quiet,
                        VarianceLines& lines);

}  // namespace malus::internal
