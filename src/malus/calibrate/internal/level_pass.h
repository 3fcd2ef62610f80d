// Noise of the frames of one source, row group by row group, sorted into the channels' signal
// levels (001 S2), row noise kept apart.
#pragma once

#include "malus/base/statistics.h"
#include "malus/calibrate/clean_frame.h"
#include "malus/calibrate/geometry.h"
#include "malus/calibrate/level_histograms.h"
#include "malus/image/view.h"

#include <vector>

namespace malus {

/// Variance to expect of a channel's pixels before their levels are measured.
struct ExpectedVariance {
  double dark_dn2 = 0, slope_dn = 0;  ///< rows and all
  double rows_dn2 = 0;                ///< where they are known
  /// light_dn: above dark.
  double at(double light_dn) const;
  double of_pixel(double light_dn) const;
};

class LevelPass {
 public:
  /// All per channel, and referred to. dark_level_dn: codes of dark pixels; bias_dn: what of it is
  /// noise, for the distributions' means; row_prior_dn2: variance of the row groups' offsets,
  /// infinite where it is not known.
  LevelPass(const MosaicGeometry& geometry, const std::vector<double>& dark_level_dn,
            const std::vector<double>& bias_dn, const std::vector<double>& row_prior_dn2,
            std::vector<LevelHistograms>& histograms);

  /// Before the frames of a source.
  void begin(const CleanFrame& clean, std::vector<ExpectedVariance> expected);
  void add(View<const float> dn, const CleanFrame& clean);
  /// Of the source: variance of the group means seen minus what pixels explain, σ_b²; below zero
  /// where there is none. And its standard error.
  double row_variance_dn2(int channel) const;
  double row_variance_error_dn2(int channel) const;

 private:
  void add_group(View<const float> dn, const CleanFrame& clean, const std::vector<double>& lamp,
                 int group);

  const MosaicGeometry& geometry_;
  const std::vector<double>&dark_, &bias_, &row_prior_;
  std::vector<LevelHistograms>& histograms_;
  std::vector<ExpectedVariance> expected_;
  double kept_ = 1.0;
  std::vector<Moments> rows_, explained_;
  std::vector<double> signal_, noise_, pixel_kept_, variance_;
};

}  // namespace malus
