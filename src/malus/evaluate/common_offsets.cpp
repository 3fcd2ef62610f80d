#include "malus/evaluate/internal/common_offsets.h"

#include "malus/base/error.h"
#include "malus/evaluate/divergence.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace malus {

void CommonOffsets::end_frame() {
  for (Level& level : levels_) {
    Sum frame;
    double off = 0, squares = 0, triples = 0;
    for (std::size_t b = 0; b < kBands; ++b) {
      const Sum& band = level.bands[b];
      if (!(band.pixels > 0)) continue;
      level.of_bands[b].add(band.mean());
      level.band_pixels[b] += band.pixels;
      frame.noise_dn += band.noise_dn;
      frame.pixels += band.pixels;
      squares += band.pixels * band.pixels;
      if (b < 2 || !(level.bands[b - 1].pixels > 0 && level.bands[b - 2].pixels > 0)) continue;
      off += std::pow(level.bands[b - 2].mean() - 2 * level.bands[b - 1].mean() + band.mean(), 2);
      triples += 6;
    }
    level.bands = {};
    if (!(frame.pixels > 0)) continue;
    level.of_frames.add(frame.mean());
    level.pixels += frame.pixels;
    level.within_frame_dn2 =
        triples > 0 ? off / triples * squares / (frame.pixels * frame.pixels) : 0.0;
  }
}

double CommonOffsets::mean_variance_dn2(std::size_t index, double pixel_variance_dn2) const {
  const Level& level = levels_[index];
  if (level.of_frames.count() == 0) return 0;
  double of_mean = level.within_frame_dn2;
  if (level.of_frames.count() > 1) {
    of_mean = 0;
    for (std::size_t i = 0; i < level.of_bands.size(); ++i) {
      if (level.of_bands[i].count() < 2) continue;
      const double share = level.band_pixels[i] / level.pixels;
      of_mean += share * share * level.of_bands[i].variance() /
                 static_cast<double>(level.of_bands[i].count());
    }
    of_mean = std::max(of_mean,
                       level.of_frames.variance() / static_cast<double>(level.of_frames.count()));
  }
  return std::max(of_mean - pixel_variance_dn2 / level.pixels, 0.0);
}

double CommonOffsets::frame_variance_dn2(std::size_t level) const {
  const Moments& of_frames = levels_[level].of_frames;
  return of_frames.count() > 1 ? of_frames.variance() : 0.0;
}

double jsd_of_offsets_bits(std::span<const std::int64_t> a, std::span<const std::int64_t> b,
                           double bin_width_dn, double variance_dn2) {
  MALUS_REQUIRE(a.size() == b.size());
  if (!(variance_dn2 > 0)) return 0;
  const std::size_t bins = a.size();
  std::vector<std::int64_t> counts(bins), moved(bins);
  double all = 0, sum = 0, squares = 0;
  for (std::size_t i = 0; i < bins; ++i) {
    counts[i] = a[i] + b[i];
    const auto n = static_cast<double>(counts[i]), at = static_cast<double>(i);
    all += n;
    sum += n * at;
    squares += n * at * at;
  }
  if (!(all > 0)) return 0;
  const double deviation = std::sqrt(std::max(squares / all - sum * sum / (all * all), 0.0));
  const auto by = static_cast<std::size_t>(std::max(std::round(deviation / 2), 1.0));
  for (std::size_t i = 0; i < bins; ++i) moved[std::min(i + by, bins - 1)] += counts[i];
  // Both are one sample: where it is small, it differs from itself by what chance makes.
  const double difference =
      std::max(*jsd_bits(counts, moved) - *jsd_floor_bits(counts, moved), 0.0);
  const double shift_dn = static_cast<double>(by) * bin_width_dn;
  return std::min(difference / (shift_dn * shift_dn) * variance_dn2, 1.0);
}

// The mean square of a power over all frequencies is that of the correlations it belongs to.
double jsd_of_spread_bits(const NoiseStructure& structure, const NoiseFrames& set,
                          const Image& frame, double frame_variance_dn2) {
  Moments pixels, all;
  for (std::size_t c = 0; c < structure.sd_dn.size(); ++c) {
    const double variance = structure.sd_dn[c] * structure.sd_dn[c];
    if (!std::isfinite(variance)) continue;
    all.add(variance);
    pixels.add(variance - structure.row_sd_dn[c] * structure.row_sd_dn[c]);
  }
  if (!(all.mean() > 0)) return 0;
  Moments rows;
  for (const double power : structure.row_power_dn2)
    rows.add(std::pow(std::max(power - pixels.mean() / frame.cols(), 0.0) / all.mean(), 2));
  double spread = std::pow(frame_variance_dn2 / all.mean(), 2) / std::max(set.count - 1, 1);
  if (rows.count() > 0) spread += rows.mean() / (static_cast<double>(set.count) * frame.rows());
  return spread / (8 * std::numbers::ln2);
}

}  // namespace malus
