#include "malus/noise/raw_variance.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/image/pack.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace malus {
namespace {

// Of which a channel's pixel is one that is_saturated(channel, cell, dn) says.
template <class IsSaturated>
SaturatedCells cells_with(const Planes& packed, const IsSaturated& is_saturated) {
  SaturatedCells cells{0, static_cast<std::int64_t>(packed[0].size())};
  for (std::size_t i = 0; i < packed[0].size(); ++i) {
    bool saturated = false;
    for (int k = 0; k < packed.channels(); ++k)
      saturated |= is_saturated(k, i, packed[k].values()[i]);
    cells.count += saturated;
  }
  return cells;
}

// The variance that a pixel of this noisy value tells. Were it that of no light for all below 0,
// its mean over the noise would be too large in the dark: so there it falls below that of no light
// by as much as it rises above it for the value's opposite, but to no less than this share, as
// noise of which most is the light's would otherwise be stated as none.
double variance_at_sample(const VarianceCurve& curve, double signal_dn) {
  constexpr double kLeastShare = 0.5;
  if (!(signal_dn < 0)) return curve(signal_dn);
  const double dark_dn2 = curve(0);
  return std::max(2 * dark_dn2 - curve(-signal_dn), kLeastShare * dark_dn2);
}

}  // namespace

std::vector<float> saturation_dn(const RawFrame& frame) {
  constexpr double kRounding = 1e-6;  // of black and white to float32
  std::vector<float> limits_dn;
  for (const double black_dn : frame.black_dn)
    limits_dn.push_back(white_is_guessed(frame)
                            ? std::numeric_limits<float>::quiet_NaN()
                            : static_cast<float>((frame.white_dn - black_dn) * (1 - kRounding)));
  return limits_dn;
}

std::string SaturatedCells::complaint() const {
  if (count == 0) return {};
  return fmt::format("{} {} ({} %) with saturated pixels: S0, DoLP and AoLP are wrong there", count,
                     count == 1 ? "cell" : "cells",
                     percent_text(static_cast<double>(count) / static_cast<double>(of)));
}

SaturatedCells saturated_cells(View<const float> dn_above_black, const SensorLayout& layout,
                               const std::vector<float>& saturated_dn) {
  MALUS_REQUIRE(std::ssize(saturated_dn) == layout.channels());
  return cells_with(pack(dn_above_black, layout), [&](int k, std::size_t, float dn) {
    return dn >= saturated_dn[static_cast<std::size_t>(k)] && std::isfinite(dn);
  });
}

SaturatedCells saturated_cells(View<const float> dn_above_black, const SensorLayout& layout,
                               const Planes& packed_variance) {
  const Planes packed = pack(dn_above_black, layout);
  MALUS_REQUIRE(packed_variance.channels() == packed.channels() &&
                packed_variance.rows() == packed.rows() && packed_variance.cols() == packed.cols());
  return cells_with(packed, [&](int k, std::size_t i, float dn) {
    return std::isnan(packed_variance[k].values()[i]) && std::isfinite(dn);
  });
}

double highest_bias_dn(const NoiseProfile& profile) {
  double bias_dn = 0;
  for (const ChannelProfile& channel : profile.channels)
    bias_dn = std::max(bias_dn, channel.bias_dn);
  return bias_dn;
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
      variance(r, c) = static_cast<float>(variance_at_sample(channel.variance, double{pixel}) +
                                          channel.sigma_row_dn * channel.sigma_row_dn +
                                          channel.sigma_column_dn * channel.sigma_column_dn);
    }
  return variance;
}

SharedOffsets shared_offsets(const NoiseProfile& profile) {
  SharedOffsets shared{{{}, profile.row_group, {}}, {}};
  for (const ChannelProfile& channel : profile.channels) {
    shared.rows.sd_dn.push_back(channel.sigma_row_dn);
    shared.columns.sd_dn.push_back(channel.sigma_column_dn);
  }
  if (!profile.row_drift.white())
    for (int lag = 1; lag < profile.layout.rows(); ++lag)
      shared.rows.correlation.push_back(row_autocorrelation(profile.row_drift, lag));
  return shared;
}

}  // namespace malus
