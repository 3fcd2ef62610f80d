// Noise that is narrower than the converter's step, from how often pixels change their code.
#pragma once

#include "malus/base/estimate.h"
#include "malus/calibrate/geometry.h"
#include "malus/image/view.h"

#include <array>
#include <string>
#include <vector>

namespace malus {

/// Counts of (code of a pixel, its code one frame later), codes counted from a channel's usual one.
struct CodePairs {
  static constexpr int kReach = 8, kCodes = 2 * kReach + 1;
  std::array<double, kCodes * kCodes> count{};
  double per_pixel = 0;  ///< pairs that one pixel has
  /// Code that stands for all below it, where the camera cuts off; none within reach.
  int lowest = -kReach;
  double& at(int first, int second) {
    return count[static_cast<std::size_t>((first + kReach) * kCodes + second + kReach)];
  }
};

/// Counts the pairs of a series of frames, per channel; none where there is no step (0). Pixels
/// more than kReach codes from the middle one of the first frame are not counted.
class CodePairCounter {
 public:
  CodePairCounter(const MosaicGeometry& geometry, double step_dn);
  void add(View<const float> dn);
  double step_dn() const { return step_dn_; }
  const std::vector<CodePairs>& pairs() const { return pairs_; }
  /// DN of the code that a channel's pairs are counted from. Contract: there is a step, and frames
  /// were added.
  double usual_code_dn(int channel) const;
  /// From now on this floor stands for all below it, in this channel; nothing without a step.
  /// Contract: frames were added.
  void end_at(double floor_dn, int channel);

 private:
  void find_middle(View<const float> dn);
  int code(float dn, int channel) const;
  MosaicGeometry geometry_;
  double step_dn_, origin_dn_ = 0;
  std::vector<int> middle_;
  Image previous_;
  std::vector<CodePairs> pairs_;
};

/// In codes: deviation of a pixel's noise from frame to frame, mean (from the usual code) and
/// deviation of the pixels' offsets, with their standard errors. A deviation of offsets that is
/// next to nothing is 0, with half of the widest that may be (two standard errors) as its error.
struct RoundedNoise {
  double sd = 0, stderr_of_sd = 0;
  double mean = 0, stderr_of_mean = 0;
  double pattern_sd = 0, stderr_of_pattern_sd = 0;
};

/// Dark noise where the converter's step hides it: narrower than 0.4 steps, EMVA 1288's limit.
struct HiddenNoise {
  bool hidden = false;
  double variance_dn2 = 0, variance_stderr_dn2 = 0;  ///< without rounding; row noise and all
  double limit_dn2 = 0;                              ///< the standard's, of variance_dn2
  double rounding_dn2 = 0;  ///< q²/12, which rounding adds once light's noise is wider than a step
  double widest_codes_dn2 = 0;  ///< variance of codes below which the noise may be hidden
  std::string unknown;          ///< not empty: why variance_dn2 is anything from 0 to the limit
  /// What rounding makes of the pixels' offsets is as wrong as of their noise. Where it is known:
  double mean_dn = 0, mean_stderr_dn = 0;  ///< of the offsets, from the usual code
  double shift_dn = 0;  ///< mean as the rounded frames show it, minus the true one
  double dsnu_dn = 0, dsnu_stderr_dn = 0;  ///< the former also of noise that is not hidden
  /// Change of the pixels' mean code per change of all offsets: that of row offsets, to first
  /// order. 1 for wide noise.
  double slope = 1, slope_stderr = 0;
  /// Variance over the pixels of what rounding leaves in their means over many frames, beyond their
  /// offsets; half of q²/12 where nothing is known.
  double left_dn2 = 0, left_stderr_dn2 = 0;
  /// Variance of what rounding may add to the mean of such frames at any other place in a code.
  double mean_doubt_dn2 = 0;
  double codes_dn2 = 0;  ///< temporal variance of the codes, were none cut off; where it is known
  bool known() const { return hidden && unknown.empty(); }
  /// Whether offsets that lie this far from those of these frames are rounded as they are.
  bool rounds_alike(double apart_dn) const;
  /// Standard deviation, over its place in a code, of what rounding adds beside q²/12 to a temporal
  /// variance that shows as this one, of pixels with these offsets. 0 from 0.75 steps on.
  double variance_doubt_dn2(double shown_dn2) const;
};

/// codes_variance_dn2: temporal variance of the codes, which says whether it may be hidden.
HiddenNoise hidden_noise(const CodePairs& pairs, double codes_variance_dn2, double step_dn);

/// Maximum likelihood of three parameters: the pixels' offsets are normal (mean and deviation,
/// which is the fixed pattern), the noise about them is normal, and what is seen is rounded. Both
/// codes of a pair share the offset, so that the pattern and the noise are told apart ("polychoric
/// correlation", Olsson, Psychometrika 44, 1979). Below half a step rounding adds no q²/12, and the
/// variance of the codes tells nothing. The error takes the pairs of one pixel for one. Undecided:
/// no pixel changes its code, all change between the same two (only the distance of the mean from
/// their boundary over the noise shows then), or an error above a quarter.
Estimate<RoundedNoise> fit_rounded_noise(const CodePairs& pairs);

}  // namespace malus
