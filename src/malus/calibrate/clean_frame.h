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
  const FrameSet* reference =
      nullptr;  ///< low-gain stack of the same scene; null: the frames' mean
};

/// What a noiseless frame of one source would be, in DN above dark.
struct CleanFrame {
  Image light_dn;
  std::vector<double> frame_mean_dn;      ///< the mean the frames had, above dark, per channel
  std::vector<double> dark_variance_dn2;  ///< temporal, of the darkest twentieth of each channel
  std::vector<double> slope_dn;           ///< rise of the variance from there to the channel's mean
  double kept = 1.0;                      ///< share of a frame's variance that noisy - clean shows
};

/// One pass over the source's frames and one over its reference's. dark_level_dn: black and dark
/// bias, per channel.
CleanFrame measure_clean(const NoiseSource& source, const RawFrame& first,
                         const MosaicGeometry& geometry, const std::vector<double>& dark_level_dn,
                         Progress& progress);

}  // namespace malus
