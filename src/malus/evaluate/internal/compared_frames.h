// One side of a comparison of noise: its frames, what each of them is compared with, and the steps
// of its codes.
#pragma once

#include "malus/base/progress.h"
#include "malus/evaluate/noise_comparison.h"
#include "malus/image/view.h"

#include <optional>

namespace malus {

/// What frames are compared with: noise is scale (frame - base). Both empty where the scene is
/// uniform.
struct NoiseGround {
  Image base, signal;  ///< signal sets the level
  float scale = 1;
  Image noise_of(Image frame) const;
};

/// Frames may be counted as if a converter had rounded them: every pixel to the codes of its own
/// that another camera's frame shows. Where a black level or a clean scene that is no whole number
/// was subtracted, and where a fixed pattern is removed, pixels have no codes in common, so no bins
/// would do for unrounded noise what rounding does for codes.
class ComparedFrames {
 public:
  /// group: frames whose mean is the fixed pattern that the histograms go without, no more than
  /// there are; 0: it is not removed. name: in messages. clean is referred to.
  ComparedFrames(const NoiseFrames& set, const std::optional<Image>& clean, int group,
                 const char* name, Progress& progress);
  int count() const { return set_.count; }

  /// As it was loaded.
  Image frame(int k) const;

  /// The converter's step [DN]; 0 of fractional pixels, and of frames that are all the same. first:
  /// frame(0).
  double step_dn(const Image& first) const;

  /// From here on counted() and of_group() are of pixels that are codes_dn + n step_dn. Contract:
  /// of the frames' size, step_dn > 0.
  void round_to(Image codes_dn, double step_dn);
  bool rounded() const { return rounded_step_dn_ > 0; }

  /// A frame as it is counted.
  Image counted(Image frame) const;

  /// Of all frames, as they were loaded.
  const NoiseGround& whole() const { return whole_; }

  /// Of the group that frame k is in, as they are counted; the last group reaches back where the
  /// count is no multiple.
  const NoiseGround& of_group(int k, Progress& progress);

 private:
  NoiseGround mean_ground(int first, int count, bool rounded, Progress& progress) const;

  NoiseFrames set_;
  const std::optional<Image>& clean_;
  int group_;
  const char* name_;
  NoiseGround whole_, of_group_;
  int first_ = -1;  ///< frame of of_group_
  Image codes_dn_;
  double rounded_step_dn_ = 0;
};

}  // namespace malus
