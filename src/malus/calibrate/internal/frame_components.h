// One bias frame taken apart: level, row, column and pixel noise of every channel (000, 3.2).
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/calibrate/internal/residual_histogram.h"
#include "malus/image/view.h"
#include "malus/noise/matrix.h"

#include <vector>

namespace malus {

/// Unbiased variance components of one frame; vectors have one entry per channel. A component that
/// is absent scatters around zero: it may be negative here and is made a deviation only after
/// averaging over frames.
struct FrameComponents {
  std::vector<double> mean_dn;              ///< above black
  std::vector<double> pixel_variance_dn2;   ///< read noise and quantisation
  std::vector<double> row_variance_dn2;     ///< σ_b²: of row-group means minus σ²_pix / n
  std::vector<double> column_variance_dn2;  ///< the same for columns
  std::vector<double> row_offset_dn;        ///< per row group: mean of all its pixels' residuals
  /// Of pixels about the mean of the rest of their group; and of those above it.
  std::vector<ResidualHistogram> residuals, residuals_above;
};

/// How far the offsets of a channel's pixels lie apart, known beforehand: a pixel's offset is then
/// estimated by its posterior mean instead of its own noisy means.
struct OffsetSpread {
  double centre_dn = 0;             ///< of the fixed pattern, black included
  double pattern_variance_dn2 = 0;  ///< of the fixed pattern among ordinary pixels
  double within_groups_dn2 = 0;     ///< of that, about the means of row groups
  double row_variance_dn2 = 0;      ///< σ_b²
  double pixel_variance_dn2 = 0;    ///< temporal, of a pixel without its rows
};

/// Takes frames apart by a two-way analysis of variance (row groups x columns).
class FrameAnalyzer {
 public:
  /// fixed_pattern_dn: mean of `frames` bias frames in DN, black included, removed first; its own
  /// share of each frame's noise, 1/frames, is accounted for. Null: nothing is removed and every
  /// frame stands alone (the papers' way). cell_dn: width of the histogram's cells per channel.
  FrameAnalyzer(const MosaicGeometry& geometry, std::vector<double> black_dn,
                const Image* fixed_pattern_dn, int frames, std::vector<double> cell_dn);

  /// From now on residuals are about posterior means of the offsets, and pixels whose mean over the
  /// other frames is no ordinary one are not among them, nor are those that `constant` marks. A
  /// pixel's own mean as its offset blurs the residuals: where all offsets lie at one phase of the
  /// converter's lattice it does so otherwise than the fit supposes, and of heavy-tailed noise not
  /// normally. Contract: the fixed pattern is removed; one entry per channel, variances not
  /// negative. constant: above 0 where a pixel never changes, which would count as noise that is
  /// narrower; empty: none.
  void expect(const std::vector<OffsetSpread>& spread, Image constant);

  FrameComponents analyze(View<const float> dn);

  /// Mean over the analysed frames of the covariance between channels' row-group offsets, DN²;
  /// diagonal: σ_b² (may be negative where absent). Channels without common groups: 0.
  SquareMatrix row_covariance_dn2() const;
  /// Variance of a residual beyond the pixel's own: the error of the offset subtracted from it.
  double offset_variance_dn2(int channel, double pixel_variance_dn2) const;

 private:
  struct Sums;
  Sums sum(View<const float> dn) const;
  struct GroupResiduals;
  void fill_group(View<const float> dn, const Sums& sums, int group, GroupResiduals& out) const;
  void fill_histograms(View<const float> dn, const Sums& sums, FrameComponents& out) const;
  void add_row_covariance(const Sums& sums, const FrameComponents& components);
  float pattern(int row, int col) const;
  struct Shares;
  Shares shares(int channel, int group_pixels) const;

  MosaicGeometry geometry_;
  std::vector<double> black_dn_;
  const Image* pattern_dn_;
  double kept_;  ///< share of a frame's variance left after the fixed pattern's removal
  std::vector<double> cell_dn_, pattern_mean_dn_;
  std::vector<OffsetSpread> spread_;  ///< empty: nothing is known of the offsets
  Image constant_;
  SquareMatrix row_products_;
  int analyzed_ = 0;
};

}  // namespace malus
