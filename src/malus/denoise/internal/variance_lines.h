// How the noise's variance rises with the signal, channel by channel: lines through its levels. Of
// estimate_profile.
#pragma once

#include "malus/noise/variance_curve.h"

#include <vector>

namespace malus::internal {

/// One point of variance against signal.
struct VarianceLevel {
  double signal, variance;
  double relative_error;  ///< of the variance, one standard error
};

/// The same values times a gain.
inline VarianceLevel scaled(const VarianceLevel& level, double gain) {
  return {level.signal * gain, level.variance * gain * gain, level.relative_error};
}

struct VarianceLine {
  double slope = 0, offset = 0, slope_error = 0, offset_error = 0;
};

struct VarianceLines {
  std::vector<std::vector<VarianceLevel>> levels;  ///< [channel], rising signals
  std::vector<VarianceLine> lines;                 ///< [channel]
  std::vector<double> weights;                     ///< of the levels that carry a line's offset
  bool black_is_known = false;  ///< then no channel's noise falls below zero at no light
  double rounding_dn2 = 0;      ///< variance of the converter's rounding: no curve falls below it
  double highest_variance = 0;  ///< of all levels, as they came
  /// [channel] the lowest code above black, where noise is cut off (cut_off.h); else below all.
  std::vector<double> floor_dn;

  /// [channel] what its values were multiplied by after the conversion (digital_gain); a line in
  /// values without it has the slope over it. Empty: 1.
  std::vector<double> gains;
  double gain(std::size_t channel) const { return gains.empty() ? 1.0 : gains[channel]; }

  /// A channel more, with a line through its own levels alone.
  void add(std::vector<VarianceLevel> of_channel, bool black_known);
  /// Whether the channels' own lines are more alike without these gains than with them: what codes
  /// tell of gains may be the camera's curve.
  bool agree_without(const std::vector<double>& of_channels) const;
  /// Lines through their levels that know of each other: channels share their gain, but for the
  /// digital one.
  void settle();
  /// Both anew, for levels that have changed.
  void refit();
  /// The channels' curves; kept: 1 for their own, 0 for that of them all.
  std::vector<VarianceCurve> curves(double kept) const;
};

}  // namespace malus::internal
