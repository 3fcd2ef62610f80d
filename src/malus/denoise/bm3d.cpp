#include "malus/denoise/bm3d.h"

#include "malus/denoise/internal/bm3d_parameters.h"
#include "malus/denoise/internal/bm3d_plain.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace malus {

Bm3dReach bm3d_reach(const Bm3dSettings& settings) {
  const auto& p = internal::bm3d_profile(settings.profile);
  const auto reach = [](const internal::Bm3dStage& s) { return 2 * (s.range + internal::kPatch); };
  return {reach(p.hard) + reach(p.wiener), 96};
}

Planes bm3d(const Planes& noisy, std::span<const float> sigma, const Bm3dSettings& settings,
            std::span<const float> match_weights, Progress& progress, Planes* variance_out) {
  const auto& p = internal::bm3d_profile(settings.profile);
  const auto channels = static_cast<std::size_t>(noisy.channels());
  MALUS_REQUIRE(sigma.size() == channels);
  MALUS_REQUIRE(match_weights.empty() || match_weights.size() == channels);
  std::vector<float> weights(match_weights.begin(), match_weights.end());
  if (weights.empty()) weights.assign(channels, 1.0F);
  check_stop(progress);
  const Planes basic =
      internal::plain::pass(noisy, sigma, weights, p.hard, p.hard_threshold, nullptr);
  Planes result = internal::plain::pass(noisy, sigma, weights, p.wiener, 0, &basic);
  if (variance_out) {
    *variance_out = Planes(noisy.channels(), noisy.rows(), noisy.cols());
    for (std::size_t c = 0; c < channels; ++c)
      std::ranges::fill((*variance_out)[static_cast<int>(c)].values(), sigma[c] * sigma[c] / 8);
  }
  return result;
}

}  // namespace malus
