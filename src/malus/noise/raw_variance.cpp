#include "malus/noise/raw_variance.h"

#include "malus/base/error.h"
#include "malus/image/pack.h"

#include <algorithm>
#include <limits>

namespace malus {

std::vector<float> saturation_dn(const RawFrame& frame) {
  constexpr double kRounding = 1e-6;  // of black and white to float32
  std::vector<float> limits_dn;
  for (const double black_dn : frame.black_dn)
    limits_dn.push_back(frame.white_known
                            ? static_cast<float>((frame.white_dn - black_dn) * (1 - kRounding))
                            : std::numeric_limits<float>::quiet_NaN());
  return limits_dn;
}

std::int64_t saturated_cells(const RawFrame& above_black, const std::vector<float>& saturated_dn) {
  const Planes packed = pack(above_black.dn, above_black.layout);
  MALUS_REQUIRE(std::ssize(saturated_dn) == packed.channels());
  std::int64_t cells = 0;
  for (std::size_t i = 0; i < packed[0].size(); ++i) {
    bool saturated = false;
    for (int k = 0; k < packed.channels(); ++k)
      saturated |= packed[k].values()[i] >= saturated_dn[static_cast<std::size_t>(k)];
    cells += saturated;
  }
  return cells;
}

void forget_saturated(Planes& variance, const RawFrame& above_black,
                      const std::vector<float>& saturated_dn) {
  const Planes packed = pack(above_black.dn, above_black.layout);
  MALUS_REQUIRE(variance.channels() == packed.channels() &&
                std::ssize(saturated_dn) == packed.channels());
  for (int k = 0; k < variance.channels(); ++k) {
    MALUS_REQUIRE(variance[k].size() == packed[k].size());
    for (std::size_t i = 0; i < packed[k].size(); ++i)
      if (packed[k].values()[i] >= saturated_dn[static_cast<std::size_t>(k)])
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

Image take_out_bias(RawFrame& above_black, const NoiseProfile& profile,
                    const std::vector<float>& saturated_dn) {
  MALUS_REQUIRE(profile.layout == above_black.layout &&
                saturated_dn.size() == profile.channels.size());
  Image variance(above_black.dn.rows(), above_black.dn.cols());
  for (int r = 0; r < variance.rows(); ++r)
    for (int c = 0; c < variance.cols(); ++c) {
      const auto k = static_cast<std::size_t>(above_black.layout.channel_at(r, c));
      const ChannelProfile& channel = profile.channels[k];
      float& pixel = above_black.dn(r, c);
      if (pixel >= saturated_dn[k]) {
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
