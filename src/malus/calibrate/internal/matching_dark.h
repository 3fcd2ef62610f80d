// What belongs to flats of one exposure without their light.
#pragma once

#include "malus/calibrate/frame_set.h"
#include "malus/calibrate/internal/bias_calibration.h"
#include "malus/calibrate/internal/gain_run.h"

#include <cstdint>
#include <optional>
#include <vector>

namespace malus {

/// Of dark frames of the flats' own exposure, or of the bias frames.
struct MatchingDark {
  std::vector<double> level_dn, variance_dn2;  ///< black included; temporal; per channel
  std::vector<double> current_dn;              ///< level above the bias frames', per channel
  std::vector<double> zero_share;              ///< ZeroShare, per channel
  std::vector<double> floor_dn;                ///< of the bias frames, where noise is cut off
  int frames = 0;                              ///< 0: the bias frames' is meant
  int set = 0;                                 ///< which of the dark sets
  Image own_shading_dn;                        ///< empty: the bias frames' is meant
  View<const float> bias_shading_dn;
  std::optional<TemporalAccumulator> own;       ///< without its mean frame
  const TemporalAccumulator* common = nullptr;  ///< the bias frames'
  /// Per channel, variance of a pixel's error in the shading, and the standard error of that.
  std::vector<double> shading_error_dn2, shading_doubt_dn2;
  int shading_frames = 1;  ///< that the shading is the mean of
  /// Exposure of the flats less that of these frames, whose dark pattern they hold beyond this one;
  /// 0 where it is the same to 1 %, or not known.
  double darkless_s = 0;
  /// Per channel: a pixel whose shading is above is a defect, which stands out of the others
  /// without light, or lies beyond half of the range.
  std::vector<double> defect_above_dn;
  /// Pixels that lie eight deviations or half of the range off the others without light, and six
  /// steps at least: hot, or stuck at a code. Line by line. What scaling a frame to a lamp's mean
  /// makes of them is no noise.
  PixelPlaces defects;

  /// Mean dark frame minus its channels' level.
  View<const float> shading_dn() const {
    return own_shading_dn.empty() ? bias_shading_dn : View<const float>(own_shading_dn);
  }
  /// variance_dn2 without these pixels.
  std::vector<double> variance_without_dn2(const PixelPlaces& left_out) const {
    return left_out.empty() ? variance_dn2 : (own ? *own : *common).variance_dn2(left_out);
  }
  /// Levels with one of these share the shading's error: that of the set, or -1 of the bias frames.
  int shading_set() const { return own_shading_dn.empty() ? -1 : set; }
};

/// Which of the dark sets is the flat's own, if any: the first of two frames or more and an
/// exposure within a hundredth of the flat's.
std::optional<int> own_dark(const FrameSet& flat, const std::vector<const FrameSet*>& darks);

/// How many frames are read for a level of flats: its own, and those of its own dark set.
std::int64_t frames_of_level(const FrameSet& flat, const std::vector<const FrameSet*>& darks);

/// What the bias frames tell of flats that have no dark frames of their own. All is referred to.
struct CommonDark {
  const DarkPass& pass;
  View<const float> shading_dn;  ///< mean bias frame minus its channels' means
};

/// The result refers to `common`. Reads the flat's own dark frames, if there are any.
MatchingDark matching_dark(const GainRun& run, const FrameSet& flat, const CommonDark& common);

}  // namespace malus
