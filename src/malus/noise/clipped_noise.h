// Noise that the camera cuts off at its lowest code: what a pixel shows is max(floor, signal +
// noise), rounded to the converter's step. Near the floor its mean is too high and its variance too
// low (censored normal distribution; Foi, "Clipped noisy images: heteroskedastic modeling and
// practical denoising", Signal Processing 89(12), 2009; the rounding, exact here, is this
// project's).
#pragma once

#include "malus/noise/profile.h"
#include "malus/noise/variance_curve.h"

namespace malus {

/// The lowest code [DN above what signals count from], and the step between codes; 0 where it is
/// not known.
struct LowestCode {
  double dn = 0, step_dn = 0;
};

/// Variances hold that of rounding, step^2 / 12.
struct MeanAndVariance {
  double mean_dn, variance_dn2;
};

/// Of what shows of a normal deviate. Contract: its variance is more than rounding's.
MeanAndVariance clipped_moments(MeanAndVariance of_normal, LowestCode floor);

/// The normal deviate that shows these. Means so near to the floor that less than a sixth of the
/// noise would show are those of a sixth.
MeanAndVariance moments_before_clipping(MeanAndVariance shown, LowestCode floor);

/// Variance of the pixels that show against their mean. highest_dn: largest signal that occurs.
VarianceCurve clipped_variance(const VarianceCurve& variance, LowestCode floor, double highest_dn);

/// The channel before its dark frames were cut off (floor above black): bias and variance of the
/// dark as a normal deviate's, of which those it has are what showed.
ChannelProfile channel_before_clipping(const ChannelProfile& channel, LowestCode floor);

/// The channel as its pixels show it: variance and law of what is cut off (floor above black and
/// bias). A stabilizer of them has the inverse that gives the signal before.
ChannelProfile clipped_channel(const ChannelProfile& channel, LowestCode floor, double highest_dn);

}  // namespace malus
