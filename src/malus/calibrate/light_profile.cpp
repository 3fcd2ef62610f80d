#include "malus/calibrate/internal/light_profile.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace malus {
namespace {

constexpr int kMostBands = 32;

// Whole cells, so that every band holds all channels alike.
int band_of(int at, int length, int cell) {
  const int cells = length / cell, bands = std::min(cells, kMostBands);
  return std::min(at / cell, cells - 1) * bands / cells;
}

}  // namespace

LightProfile::LightProfile(const MosaicGeometry& geometry, std::vector<double> dark_dn)
    : geometry_(geometry), dark_dn_(std::move(dark_dn)) {
  const auto count = [](int length, int cell, int across, std::vector<double>& pixels) {
    pixels.assign(as_index(std::min(length / cell, kMostBands)), 0.0);
    for (int i = 0; i < length; ++i) pixels[as_index(band_of(i, length, cell))] += across;
  };
  count(geometry.rows(), geometry.cell_rows(), geometry.cols(), rows_.pixels);
  count(geometry.cols(), geometry.cell_cols(), geometry.rows(), columns_.pixels);
}

void LightProfile::add(View<const float> dn) {
  std::vector<double> rows(rows_.pixels.size(), 0.0), of_column(as_index(geometry_.cols()), 0.0),
      columns(columns_.pixels.size(), 0.0);
  double all = 0;
  for (int r = 0; r < geometry_.rows(); ++r) {
    double row = 0;
    for (int c = 0; c < geometry_.cols(); ++c) {
      const double light = dn(r, c) - dark_dn_[as_index(geometry_.channel(r, c))];
      row += light;
      of_column[as_index(c)] += light;
    }
    rows[as_index(band_of(r, geometry_.rows(), geometry_.cell_rows()))] += row;
    all += row;
  }
  for (int c = 0; c < geometry_.cols(); ++c)
    columns[as_index(band_of(c, geometry_.cols(), geometry_.cell_cols()))] +=
        of_column[as_index(c)];
  light_ += all;
  frame_sums_dn_.push_back(all);
  rows_.sums_dn.push_back(std::move(rows));
  columns_.sums_dn.push_back(std::move(columns));
}

// Masked rows and columns have no light to change, and by theirs noise would be divided.
bool LightProfile::is_lit(const Bands& bands, std::size_t band) const {
  double sum = 0;
  for (const std::vector<double>& frame : bands.sums_dn) sum += frame[band];
  return sum / bands.pixels[band] >= kUnlitShare * light_ / all_pixels();
}

double LightProfile::band_variance_dn2(const Bands& bands, std::size_t band,
                                       FrameAlignment alignment,
                                       const std::vector<double>& relative_light) const {
  const bool scaled = alignment == FrameAlignment::kMultiplicative;
  const double all = all_pixels();
  const auto frames = static_cast<double>(bands.sums_dn.size());
  double above_dn = -light_ / (frames * all);  // the band's mean light over the frame's
  for (const std::vector<double>& sums : bands.sums_dn)
    above_dn += sums[band] / (frames * bands.pixels[band]);
  Moments of_band;
  for (std::size_t f = 0; f < bands.sums_dn.size(); ++f) {
    const double sum = bands.sums_dn[f][band], of_frame = frame_sums_dn_[f];
    const double of_lamp = relative_light.empty() ? 0.0 : (relative_light[f] - 1.0) * above_dn;
    of_band.add(scaled ? sum / of_frame : sum / bands.pixels[band] - of_frame / all - of_lamp);
  }
  if (!scaled) return of_band.variance();
  const double relative = of_band.variance() / (of_band.mean() * of_band.mean());
  const double mean_dn = light_ / (frames * all);
  return relative * mean_dn * mean_dn;
}

// A band's mean scatters by its n pixels' noise, which the frame's N pixels' takes a part of:
// σ² (1/n - 1/N).
double LightProfile::excess_dn2(const Bands& bands, double variance_dn2, FrameAlignment alignment,
                                const std::vector<double>& relative_light,
                                double& standard_error_dn2, int& lit) const {
  const auto frames = static_cast<double>(bands.sums_dn.size());
  double excess = 0, squares = 0;
  for (std::size_t b = 0; b < bands.pixels.size(); ++b) {
    if (alignment == FrameAlignment::kMultiplicative && !is_lit(bands, b)) continue;
    ++lit;
    const double noise = variance_dn2 * (1.0 / bands.pixels[b] - 1.0 / all_pixels());
    excess += band_variance_dn2(bands, b, alignment, relative_light) - noise;
    squares += noise * noise;
  }
  const auto count = static_cast<double>(std::max(lit, 1));
  standard_error_dn2 = std::sqrt(2.0 * squares / (frames - 1.0)) / count;
  return excess / count;
}

LightChange LightProfile::change(double variance_dn2, FrameAlignment alignment,
                                 const std::vector<double>& relative_light) const {
  LightChange out;
  if (frame_sums_dn_.size() < 2) return out;
  if (alignment == FrameAlignment::kMultiplicative && !(light_ > 0)) return out;
  out.rows_dn2 = excess_dn2(rows_, variance_dn2, alignment, relative_light, out.rows_stderr_dn2,
                            out.row_bands);
  out.columns_dn2 = excess_dn2(columns_, variance_dn2, alignment, relative_light,
                               out.columns_stderr_dn2, out.column_bands);
  return out;
}

}  // namespace malus
