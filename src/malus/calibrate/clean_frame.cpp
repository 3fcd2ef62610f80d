#include "malus/calibrate/clean_frame.h"

#include "malus/base/index.h"

#include <algorithm>

namespace malus {
namespace {

TemporalAccumulator accumulate(const FrameSet& set, const RawFrame& first,
                               const MosaicGeometry& geometry,
                               const std::vector<double>& dark_level_dn, FrameAlignment alignment,
                               Progress& progress) {
  TemporalAccumulator temporal(geometry, dark_level_dn, alignment);
  for_each_frame(set, &first, progress,
                 [&](const RawFrame& frame, int) { temporal.add(frame.dn); });
  return temporal;
}

// clean = slope * reference per channel, the line fitted to the frames' own mean; the intercept is
// the dark bias that black subtraction left and belongs to the noise.
void map_reference(const Image& reference_dn, const MosaicGeometry& geometry, Image& mean_dn) {
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    double n = 0, x = 0, y = 0, xx = 0, xy = 0;
    const auto for_pixels = [&](auto&& use) {
      for (int r = channel / geometry.cell_cols(); r < geometry.rows(); r += geometry.cell_rows())
        for (int c = channel % geometry.cell_cols(); c < geometry.cols(); c += geometry.cell_cols())
          use(r, c);
    };
    for_pixels([&](int r, int c) {
      const double u = reference_dn(r, c), v = mean_dn(r, c);
      n += 1;
      x += u;
      y += v;
      xx += u * u;
      xy += u * v;
    });
    const double spread = xx - x * x / n;
    const double slope = spread > 0 ? (xy - x * y / n) / spread : (x > 0 ? y / x : 0.0);
    for_pixels(
        [&](int r, int c) { mean_dn(r, c) = static_cast<float>(slope * reference_dn(r, c)); });
  }
}

// Variance in the darkest twentieth of each channel and its rise to the mean: what the bins of the
// histograms have to suit.
void measure_range(const TemporalAccumulator& temporal, const MosaicGeometry& geometry,
                   CleanFrame& clean) {
  const std::vector<double> variance = temporal.variance_dn2();
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    std::vector<std::pair<float, float>> light_and_squares;
    const std::int64_t step = 1 + geometry.channel_pixels(channel) / 50000;
    std::int64_t index = 0;
    for (int r = channel / geometry.cell_cols(); r < geometry.rows(); r += geometry.cell_rows())
      for (int c = channel % geometry.cell_cols(); c < geometry.cols(); c += geometry.cell_cols())
        if (index++ % step == 0)
          light_and_squares.emplace_back(clean.light_dn(r, c), temporal.sum_of_squares()(r, c));
    const auto darkest = static_cast<std::ptrdiff_t>(light_and_squares.size() / 20 + 1);
    std::nth_element(light_and_squares.begin(), light_and_squares.begin() + darkest - 1,
                     light_and_squares.end());
    double light = 0, squares = 0;
    for (std::ptrdiff_t i = 0; i < darkest; ++i) {
      light += light_and_squares[static_cast<std::size_t>(i)].first;
      squares += light_and_squares[static_cast<std::size_t>(i)].second;
    }
    const auto n = static_cast<double>(darkest);
    const double dark = squares / n / (temporal.frames() - 1.0), all = variance[as_index(channel)];
    const double rise = clean.frame_mean_dn[as_index(channel)] - light / n;
    clean.dark_variance_dn2.push_back(dark);
    // On a flat field there is no rise to see: all of the variance may be shot noise.
    const double mean = std::max(clean.frame_mean_dn[as_index(channel)], 1e-6);
    clean.slope_dn.push_back(rise > 0.2 * mean && all > dark ? (all - dark) / rise : all / mean);
  }
}

}  // namespace

CleanFrame measure_clean(const NoiseSource& source, const RawFrame& first,
                         const MosaicGeometry& geometry, const std::vector<double>& dark_level_dn,
                         Progress& progress) {
  const FrameAlignment alignment = source.frames->kind == FrameKind::kBias
                                       ? FrameAlignment::kAdditive
                                       : FrameAlignment::kMultiplicative;
  TemporalAccumulator temporal =
      accumulate(*source.frames, first, geometry, dark_level_dn, alignment, progress);
  CleanFrame clean;
  clean.frame_mean_dn = temporal.mean_dn();
  clean.light_dn = temporal.release_mean_frame_dn();
  measure_range(temporal, geometry, clean);
  if (source.reference) {
    TemporalAccumulator reference = accumulate(*source.reference, first, geometry, first.black_dn,
                                               FrameAlignment::kMultiplicative, progress);
    map_reference(reference.release_mean_frame_dn(), geometry, clean.light_dn);
  } else {
    clean.kept = 1.0 - 1.0 / source.frames->count;
  }
  if (source.frames->kind == FrameKind::kBias) clean.frame_mean_dn.clear();
  return clean;
}

}  // namespace malus
