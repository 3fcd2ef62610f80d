// The clean picture behind repeated frames of one scene: the first pass of measuring noise from it.
#pragma once

#include "malus/calibrate/frame_set.h"
#include "malus/calibrate/geometry.h"
#include "malus/calibrate/temporal.h"

#include <vector>

namespace malus {

/// Frames of one static scene that noise is taken from, and the cleaner ones it is compared with.
struct NoiseSource {
  const FrameSet* frames = nullptr;  ///< bias, flat or burst
  /// Low-gain stack of the same scene; null: the frames' mean.
  const FrameSet* reference = nullptr;
};

/// The signal's zero, per channel.
struct DarkLevel {
  std::vector<double> dn;  ///< black and, where bias frames told it, the dark bias
  bool measured = false;   ///< else it is black alone
};

/// What a noiseless frame of one source would be, in DN above dark.
struct CleanFrame {
  Image light_dn;
  std::vector<double> frame_mean_dn;      ///< the mean the frames had, above dark, per channel
  std::vector<double> dark_variance_dn2;  ///< temporal, of the darkest twentieth of each channel
  std::vector<double> slope_dn;           ///< rise of the variance from there to the channel's mean
  double rows_kept = 1.0;                 ///< share of the rows' variance that noisy - clean shows
  Image pixel_kept;  ///< of a pixel's variance, with a reference; empty: rows_kept
  double kept(int row, int col) const {
    return pixel_kept.empty() ? rows_kept : double{pixel_kept(row, col)};
  }
};

/// The square of one pixel's own noise, unbiased, from its residual about the mean of the n pixels
/// of its row group, whose mean variance is group_variance. That mean holds all its pixels' noise:
/// a residual about it has the variance v (1 - 2/n) + p/n, v the pixel's own and p the group's mean
/// variance. In the row of a scene, dark pixels would take over a bright neighbour's variance.
inline double own_square(double residual, double group_variance, int n) {
  return n > 2 ? (residual * residual - group_variance / n) / (1.0 - 2.0 / n)
               : residual * residual / (1.0 - 1.0 / n);
}

/// The mean of the N frames themselves, in which each of them has its share: noisy - clean shows
/// 1 - 1/N of their variance. A reference, mapped to the frames by a fitted line, is averaged with
/// it at inverse variance. Its error, whether noise, fixed pattern, or not quite the scene, is
/// measured as its difference from the frames' mean, a few hundred pixels of like signal at a time;
/// of that difference the weighted part is added to the residuals and known, so that what remains
/// is the frames' temporal noise however bad the reference is. One pass over the source's frames
/// and one over its reference's.
CleanFrame measure_clean(const NoiseSource& source, const FrameFormat& format,
                         const MosaicGeometry& geometry, const DarkLevel& dark, Progress& progress);

}  // namespace malus
