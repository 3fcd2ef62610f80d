#include "malus/calibrate/internal/level_pass.h"

#include "malus/base/index.h"
#include "malus/calibrate/internal/row_offset.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace malus {

double ExpectedVariance::at(double light_dn) const {
  return dark_dn2 + slope_dn * std::max(light_dn, 0.0);
}

double ExpectedVariance::of_pixel(double light_dn) const {
  constexpr double kLeastOfDark = 0.05;
  return std::max(at(light_dn) - rows_dn2, kLeastOfDark * dark_dn2);
}

LevelPass::LevelPass(const MosaicGeometry& geometry, const std::vector<double>& dark_level_dn,
                     const std::vector<double>& bias_dn, const std::vector<double>& row_prior_dn2,
                     std::vector<LevelHistograms>& histograms)
    : geometry_(geometry),
      dark_(dark_level_dn),
      bias_(bias_dn),
      row_prior_(row_prior_dn2),
      histograms_(histograms) {}

void LevelPass::begin(const CleanFrame& clean, std::vector<ExpectedVariance> expected) {
  expected_ = std::move(expected);
  kept_ = clean.rows_kept;
  rows_.assign(dark_.size(), Moments());
  explained_ = rows_;
}

void LevelPass::add(View<const float> dn, const CleanFrame& clean) {
  std::vector<double> lamp(dark_.size(), 1.0);
  if (!clean.frame_mean_dn.empty()) {
    const std::vector<double> mean = channel_means(dn, geometry_);
    for (std::size_t c = 0; c < lamp.size(); ++c)
      if (clean.frame_mean_dn[c] > 0) lamp[c] = (mean[c] - dark_[c]) / clean.frame_mean_dn[c];
  }
  for (int group = 0; group < geometry_.groups(); ++group) add_group(dn, clean, lamp, group);
}

double LevelPass::row_variance_dn2(int channel) const {
  return rows_[as_index(channel)].variance() - explained_[as_index(channel)].mean();
}

double LevelPass::row_variance_error_dn2(int channel) const {
  // Offsets about their own mean over the frames tell as much as `kept` of their number.
  return rows_[as_index(channel)].variance_standard_error() / std::sqrt(kept_);
}

void LevelPass::add_group(View<const float> dn, const CleanFrame& clean,
                          const std::vector<double>& lamp, int group) {
  const int begin = group * geometry_.row_group();
  const int end = std::min(begin + geometry_.row_group(), geometry_.rows());
  const bool bias_frame = clean.frame_mean_dn.empty();
  for (int channel = 0; channel < geometry_.channels(); ++channel) {
    const auto c = as_index(channel);
    const int n = geometry_.group_pixels(group, channel);
    if (n < 2) continue;
    signal_.clear();
    noise_.clear();
    pixel_kept_.clear();
    variance_.clear();
    double sum = 0, square = 0, kept = 0;
    for (int r = begin; r < end; ++r) {
      if (r % geometry_.cell_rows() != channel / geometry_.cell_cols()) continue;
      for (int col = channel % geometry_.cell_cols(); col < geometry_.cols();
           col += geometry_.cell_cols()) {
        const double light = lamp[c] * clean.light_dn(r, col);
        const double noise = dn(r, col) - dark_[c] - light;
        signal_.push_back(bias_frame ? 0.0 : light);
        noise_.push_back(noise);
        pixel_kept_.push_back(clean.kept(r, col));
        variance_.push_back(pixel_kept_.back() * expected_[c].of_pixel(light));
        kept += pixel_kept_.back() / n;
        sum += noise;
        square += noise * noise;
      }
    }
    const double mean = sum / n, pixel = (square - n * mean * mean) / (n - 1);
    rows_[c].add(mean / std::sqrt(clean.rows_kept));
    explained_[c].add(pixel / n / kept);
    RowOffset offset(row_prior_[c] * clean.rows_kept);
    offset.fit(noise_, variance_);
    for (std::size_t i = 0; i < noise_.size(); ++i) {
      const double own_kept = pixel_kept_[i];
      histograms_[c].add(signal_[i], offset.residual_dn(i) / std::sqrt(own_kept) + bias_[c]);
      histograms_[c].add_square(signal_[i], offset.raw_dn(i), offset.square_dn2(i) / own_kept,
                                offset.freedom(i) * own_kept);
    }
  }
}

}  // namespace malus
