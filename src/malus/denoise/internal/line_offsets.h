// Offsets of whole rows or columns, as frames hold them: one draw in units of every channel's own
// deviation.
#pragma once

#include "malus/base/parallel.h"
#include "malus/denoise/saturated_pixels.h"
#include "malus/image/view.h"
#include "malus/noise/profile.h"

namespace malus::internal {

/// dn -= offset(row, col) * the channel's sigma_dn, for every pixel that is not saturated.
template <class Offset>
void subtract_offsets(View<float> dn, const NoiseProfile& profile, double ChannelProfile::*sigma_dn,
                      const SaturatedPixels& saturated, const Offset& offset) {
  parallel_for(0, dn.rows(), 32, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < dn.cols(); ++c) {
        const auto k = static_cast<std::size_t>(profile.layout.channel_at(r, c));
        if (!saturated(r, c))
          dn(r, c) -= static_cast<float>(offset(r, c) * profile.channels[k].*sigma_dn);
      }
  });
}

}  // namespace malus::internal
