#include "malus/denoise/bm3d.h"

#include "malus/denoise/internal/bm3d_pass.h"

#include <cmath>
#include <numeric>
#include <vector>

namespace malus {

Bm3dReach bm3d_reach(const Bm3dSettings& settings) {
  const auto& p = internal::bm3d_profile(denoise_profile(settings.profile));
  return internal::bm3d_reach(p);
}

Planes bm3d(const Planes& noisy, std::span<const float> sigma, const Bm3dSettings& settings,
            std::span<const float> match_weights, Progress& progress, Planes* variance_out) {
  const auto& parameters = internal::bm3d_profile(denoise_profile(settings.profile));
  return internal::bm3d_with(parameters, noisy, sigma, match_weights, progress, variance_out);
}

}  // namespace malus
