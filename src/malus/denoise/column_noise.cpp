#include "malus/denoise/column_noise.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/line_offsets.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace malus {
namespace {

// By blocks: whole columns would fetch a cache line for every pixel.
Image with_axes_exchanged(View<const float> dn) {
  constexpr int kBlock = 32;
  Image out(dn.cols(), dn.rows());
  parallel_for(0, (dn.cols() + kBlock - 1) / kBlock, 1,
               [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
                 for (int first = 0; first < dn.rows(); first += kBlock)
                   for (int c = static_cast<int>(begin) * kBlock;
                        c < std::min(static_cast<int>(end) * kBlock, dn.cols()); ++c)
                     for (int r = first; r < std::min(first + kBlock, dn.rows()); ++r)
                       out(c, r) = dn(r, c);
               });
  return out;
}

SensorLayout with_axes_exchanged(const SensorLayout& layout) {
  std::vector<std::vector<std::string>> sites(static_cast<std::size_t>(layout.cols()));
  for (int c = 0; c < layout.cols(); ++c)
    for (int r = 0; r < layout.rows(); ++r)
      sites[static_cast<std::size_t>(c)].push_back(layout.channel_name(layout.channel_at(r, c)));
  return SensorLayout::from_sites(sites);
}

// What the estimator of rows asks for, of the exchanged frame.
struct ExchangedProfile {
  NoiseProfile profile;
  std::vector<float> saturated_dn;
};

ExchangedProfile with_axes_exchanged(const NoiseProfile& profile,
                                     const std::vector<float>& saturated_dn) {
  ExchangedProfile out;
  out.profile.layout = with_axes_exchanged(profile.layout);
  for (int c = 0; c < profile.layout.cols(); ++c)
    for (int r = 0; r < profile.layout.rows(); ++r) {
      const auto k = static_cast<std::size_t>(profile.layout.channel_at(r, c));
      out.profile.channels.push_back(profile.channels[k]);
      out.profile.channels.back().sigma_row_dn = profile.channels[k].sigma_column_dn;
      out.saturated_dn.push_back(saturated_dn[k]);
    }
  return out;
}

// Edges and faint stripes down the whole picture lift whole columns by no more than a camera does,
// but neighbours alike, where a camera draws every column's offset anew. What columns share with
// those so far away, further than two that a converter serves together, is the picture's. Their
// offsets come from other differences: multiples of the layout's period away.
constexpr std::size_t kLag = 3;
constexpr double kColumnChance = 3.0;  // in standard errors of a white sequence's autocovariance

// Of a sum of the camera's offsets and the picture's, in these shares of its variance, the former
// are expected to be their share of it, and to be missed by the product of the shares (Wiener).
void leave_what_columns_share(RowNoise& columns) {
  const std::vector<double>& offset = columns.offset;
  if (offset.size() <= kLag) return;
  double square = 0, product = 0;
  for (const double o : offset) square += o * o;
  for (std::size_t c = kLag; c < offset.size(); ++c) product += offset[c] * offset[c - kLag];
  const auto count = static_cast<double>(offset.size());
  const double picture = product / square;
  if (!(picture > kColumnChance / std::sqrt(count))) return;
  const double camera = 1 - std::min(picture, 1.0), missed = camera * picture * square / count;
  for (double& o : columns.offset) o *= camera;
  for (double& deviation : columns.deviation)
    deviation = std::min(std::sqrt(deviation * deviation + missed), 1.0);
}

}  // namespace

RowNoise estimate_column_noise(View<const float> dn, const NoiseProfile& profile,
                               const std::vector<float>& saturated_dn) {
  MALUS_REQUIRE(saturated_dn.size() == profile.channels.size());
  const ExchangedProfile exchanged = with_axes_exchanged(profile, saturated_dn);
  RowNoise columns =
      estimate_row_noise(with_axes_exchanged(dn), exchanged.profile, exchanged.saturated_dn);
  leave_what_columns_share(columns);
  return columns;
}

void remove_column_noise(View<float> dn, const NoiseProfile& profile, const RowNoise& columns,
                         const SaturatedPixels& saturated) {
  internal::subtract_offsets(
      dn, profile, &ChannelProfile::sigma_column_dn, saturated,
      [&](int, int col) { return columns.offset[static_cast<std::size_t>(col)]; });
}

std::optional<ShownRowVariance> shown_column_variance(View<const float> dn,
                                                      const NoiseProfile& profile,
                                                      const std::vector<float>& saturated_dn) {
  const ExchangedProfile exchanged = with_axes_exchanged(profile, saturated_dn);
  return shown_row_variance(with_axes_exchanged(dn), exchanged.profile, exchanged.saturated_dn);
}

}  // namespace malus
