#include "malus/noise/raw_variance.h"

#include "malus/base/error.h"
#include "malus/image/pack.h"

#include <algorithm>
#include <limits>

namespace malus {

float saturation_dn(const RawFrame& above_black) {
  if (!above_black.white_known) return std::numeric_limits<float>::quiet_NaN();
  constexpr double kRounding = 1e-6;  // of black and white to float32
  return static_cast<float>(above_black.white_dn * (1 - kRounding));
}

std::int64_t saturated_cells(const RawFrame& above_black) {
  const Planes packed = pack(above_black.dn, above_black.layout);
  const float limit_dn = saturation_dn(above_black);
  std::int64_t cells = 0;
  for (std::size_t i = 0; i < packed[0].size(); ++i)
    cells += std::any_of(packed.begin(), packed.end(),
                         [&](const Image& plane) { return plane.values()[i] >= limit_dn; });
  return cells;
}

void forget_saturated(Planes& variance, const RawFrame& above_black) {
  const float limit_dn = saturation_dn(above_black);
  const Planes packed = pack(above_black.dn, above_black.layout);
  MALUS_REQUIRE(variance.channels() == packed.channels());
  for (int k = 0; k < variance.channels(); ++k) {
    MALUS_REQUIRE(variance[k].size() == packed[k].size());
    for (std::size_t i = 0; i < packed[k].size(); ++i)
      if (packed[k].values()[i] >= limit_dn)
        variance[k].values()[i] = std::numeric_limits<float>::quiet_NaN();
  }
}

void subtract_bias(Image& dn, const NoiseProfile& profile) {
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c) {
      const auto k = static_cast<std::size_t>(profile.layout.channel_at(r, c));
      dn(r, c) -= static_cast<float>(profile.channels[k].bias_dn);
    }
}

Image take_out_bias(RawFrame& above_black, const NoiseProfile& profile) {
  MALUS_REQUIRE(profile.layout == above_black.layout);
  const float limit_dn = saturation_dn(above_black);
  Image variance(above_black.dn.rows(), above_black.dn.cols());
  for (int r = 0; r < variance.rows(); ++r)
    for (int c = 0; c < variance.cols(); ++c) {
      const auto k = static_cast<std::size_t>(above_black.layout.channel_at(r, c));
      const ChannelProfile& channel = profile.channels[k];
      float& pixel = above_black.dn(r, c);
      if (pixel >= limit_dn) {
        variance(r, c) = std::numeric_limits<float>::quiet_NaN();
        continue;
      }
      pixel -= static_cast<float>(channel.bias_dn);
      variance(r, c) = static_cast<float>(channel.variance(std::max(double{pixel}, 0.0)) +
                                          channel.sigma_row_dn * channel.sigma_row_dn);
    }
  return variance;
}

}  // namespace malus
