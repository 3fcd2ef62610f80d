#include "malus/calibrate/internal/lamp_flicker.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/noise/row_drift.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace malus {
namespace {

constexpr int kAcrossLamp = 16;
constexpr std::size_t kLampBlocks = std::size_t{kAcrossLamp} * kAcrossLamp;

}  // namespace

// One channel's frames on its shading: along is Σ w x y / √S of blocks y whose mean light is x
// above the channel's, w their share of the pixels, S = Σ w x². Its variance over the frames is
// what flicker adds to that of the pixels.
struct LampFlicker::Channel {
  double pixels = 0, light_dn = 0;
  double contrast_dn2 = 0;           ///< S; 0: not known
  std::vector<double> along, means;  ///< per frame, DN
  double row_share = 0;              ///< variance of along for one of rows, times their number
};

LampFlicker::LampFlicker(const MosaicGeometry& geometry, std::vector<double> dark_dn,
                         View<const float> shading_dn, const PixelPlaces& left_out)
    : geometry_(geometry),
      dark_dn_(std::move(dark_dn)),
      shading_dn_(shading_dn),
      left_out_(left_out),
      pixels_(as_index(geometry.channels()) * kLampBlocks, 0.0) {
  for (int c = 0; c < geometry.channels(); ++c)
    for_channel(geometry, c, [&](int r, int col, int, int) { pixels_[block(c, r, col)] += 1.0; });
  for (const auto& [row, col] : left_out_)
    pixels_[block(geometry_.channel(row, col), row / geometry_.cell_rows(),
                  col / geometry_.cell_cols())] -= 1.0;
}

std::size_t LampFlicker::block(int channel, int r, int c) const {
  const int down = r * kAcrossLamp / geometry_.channel_rows(channel),
            right = c * kAcrossLamp / geometry_.channel_cols(channel);
  return as_index(channel) * kLampBlocks + as_index(down * kAcrossLamp + right);
}

void LampFlicker::add(View<const float> dn) {
  std::vector<double> sums(pixels_.size(), 0.0);
  const auto light = [&](int row, int col, int channel) {
    return double{dn(row, col)} - dark_dn_[as_index(channel)] - shading_dn_(row, col);
  };
  for (int c = 0; c < geometry_.channels(); ++c)
    for_channel(geometry_, c, [&](int r, int col_of_channel, int row, int col) {
      sums[block(c, r, col_of_channel)] += light(row, col, c);
    });
  for (const auto& [row, col] : left_out_) {
    const int c = geometry_.channel(row, col);
    sums[block(c, row / geometry_.cell_rows(), col / geometry_.cell_cols())] -= light(row, col, c);
  }
  sums_.push_back(std::move(sums));
}

LampFlicker::Channel LampFlicker::channel(int c) const {
  const std::size_t first = as_index(c) * kLampBlocks;
  Channel out;
  std::vector<double> above(kLampBlocks, 0.0);
  for (std::size_t b = 0; b < kLampBlocks; ++b) {
    out.pixels += pixels_[first + b];
    for (const std::vector<double>& sums : sums_)
      above[b] += sums[first + b] / static_cast<double>(sums_.size());
    out.light_dn += above[b];
  }
  if (!(out.pixels > 0 && out.light_dn > 0)) return out;
  out.light_dn /= out.pixels;
  for (std::size_t b = 0; b < kLampBlocks; ++b) {
    const double own = pixels_[first + b];
    above[b] = own > 0 ? above[b] / own - out.light_dn : 0.0;
    out.contrast_dn2 += own / out.pixels * above[b] * above[b];
  }
  if (!(out.contrast_dn2 > 0)) return out;
  const double per_pixel = 1.0 / (std::sqrt(out.contrast_dn2) * out.pixels);
  for (const std::vector<double>& sums : sums_) {
    double along = 0, all = 0;
    for (std::size_t b = 0; b < kLampBlocks; ++b) {
      along += above[b] * sums[first + b] * per_pixel;
      all += sums[first + b];
    }
    out.along.push_back(along);
    out.means.push_back(all / out.pixels);
  }
  for (int down = 0; down < kAcrossLamp; ++down) {
    double weight = 0;
    for (int right = 0; right < kAcrossLamp; ++right) {
      const auto b = as_index(down * kAcrossLamp + right);
      weight += above[b] * pixels_[first + b] * per_pixel;
    }
    out.row_share += weight * weight * kAcrossLamp;
  }
  return out;
}

double LampFlicker::variance_dn2(int c, const Channel& own, double pixel_variance_dn2,
                                 const FrameRowNoise& rows) const {
  constexpr double kOfNoise = 10.0, kOfMeans = 0.5;
  if (!(own.contrast_dn2 > 0)) return 0;
  Moments along;
  for (const double dn : own.along) along.add(dn);
  double product = 0;
  for (std::size_t f = 0; f < own.along.size(); ++f)
    product += (own.along[f] - along.mean()) * (own.means[f] - own.light_dn) /
               static_cast<double>(own.along.size() - 1);
  const double row_dn = rows.sigma_dn[as_index(c)];
  const double noise = pixel_variance_dn2 / own.pixels + own.row_share * row_dn * row_dn *
                                                             row_power(rows.drift, 0.0) /
                                                             geometry_.channel_groups(c);
  // Of a lamp alone is along / √S = means / light.
  const bool with_means =
      product * std::sqrt(own.contrast_dn2) > kOfMeans * along.variance() * own.light_dn;
  return along.variance() > kOfNoise * noise && with_means ? along.variance() - noise : 0.0;
}

Flicker LampFlicker::flicker(const std::vector<double>& temporal_dn2,
                             const FrameRowNoise& rows) const {
  Flicker out;
  out.variance_dn2.assign(temporal_dn2.size(), 0.0);
  if (sums_.size() < 2) return out;
  double weight = 0;
  std::vector<double> light(sums_.size(), 0.0);
  for (int c = 0; c < geometry_.channels(); ++c) {
    const Channel own = channel(c);
    const double variance = variance_dn2(c, own, temporal_dn2[as_index(c)], rows);
    if (!(variance > 0)) continue;
    out.variance_dn2[as_index(c)] = variance;
    weight += own.contrast_dn2;
    for (std::size_t f = 0; f < light.size(); ++f)
      light[f] += std::sqrt(own.contrast_dn2) * own.along[f];
  }
  if (!(weight > 0)) return out;
  for (double& l : light) l /= weight;
  out.relative_light = std::move(light);
  return out;
}

}  // namespace malus
