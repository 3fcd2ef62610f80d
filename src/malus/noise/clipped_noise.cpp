#include "malus/noise/clipped_noise.h"

#include "malus/base/error.h"
#include "malus/base/normal_distribution.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace malus {
namespace {

constexpr double kFar = 6.0;          // deviations above the floor: nothing is cut off
constexpr double kLeastShown = -1.0;  // deviations: a sixth of the noise lies above the floor
constexpr double kCurveStep = 0.05;   // deviations
constexpr double kFineStep = 0.1;     // deviations: rounding adds a twelfth of its square, no more

// Of max(0, z + a standard normal deviate), rounded to multiples of a step.
MeanAndVariance clipped_standard(double z, double step) {
  double mean = 0, square = 0;
  if (step < kFineStep) {
    mean = mean_above_zero(z);
    square = (z * z + 1 + step * step / 12) * normal_cdf(z) + z * normal_density(z);
  } else {
    // Sums over the codes k of P(code >= k), and of that times (2k - 1).
    constexpr double kNone = 8.0;
    for (double at = 0.5 * step; at < z + kNone; at += step) {
      const double above = normal_cdf(z - at);
      mean += step * above;
      square += 2 * at * step * above;
    }
  }
  return {mean, std::max(square - mean * mean, 0.0)};
}

double without_rounding(double variance_dn2, LowestCode floor) {
  return variance_dn2 - floor.step_dn * floor.step_dn / 12;
}

}  // namespace

MeanAndVariance clipped_moments(MeanAndVariance of_normal, LowestCode floor) {
  const double variance_dn2 = without_rounding(of_normal.variance_dn2, floor);
  MALUS_REQUIRE(variance_dn2 > 0);
  const double deviation = std::sqrt(variance_dn2);
  const double z = (of_normal.mean_dn - floor.dn) / deviation;
  if (z > kFar) return of_normal;
  const MeanAndVariance standard = clipped_standard(z, floor.step_dn / deviation);
  return {floor.dn + deviation * standard.mean_dn, variance_dn2 * standard.variance_dn2};
}

// Variance over squared mean falls with the distance from the floor. How coarse the rounding is
// follows from the deviation, which follows from the distance: round by round.
MeanAndVariance moments_before_clipping(MeanAndVariance shown, LowestCode floor) {
  const double mean = shown.mean_dn - floor.dn;
  double deviation = std::sqrt(shown.variance_dn2), z = kFar;
  constexpr int kRounds = 20, kHalvings = 40;
  for (int round = 0; round < kRounds; ++round) {
    const double step = floor.step_dn / deviation;
    const auto varies_less_than_shown = [&](double at) {
      const MeanAndVariance standard = clipped_standard(at, step);
      return standard.variance_dn2 * mean * mean <
             shown.variance_dn2 * standard.mean_dn * standard.mean_dn;
    };
    if (!(mean > 0) || !varies_less_than_shown(kFar)) return shown;
    double low = kLeastShown, high = kFar;
    for (int i = 0; i < kHalvings; ++i) {
      const double middle = 0.5 * (low + high);
      (varies_less_than_shown(middle) ? high : low) = middle;
    }
    z = low;
    deviation = mean / clipped_standard(z, step).mean_dn;
  }
  return {floor.dn + z * deviation, deviation * deviation + floor.step_dn * floor.step_dn / 12};
}

VarianceCurve clipped_variance(const VarianceCurve& variance, LowestCode floor, double highest_dn) {
  std::vector<double> signal, shown;
  double s = 0;
  for (bool far = false; !far;) {
    const MeanAndVariance moments = clipped_moments({s, variance(s)}, floor);
    signal.push_back(moments.mean_dn);
    shown.push_back(moments.variance_dn2);
    const double deviation = std::sqrt(variance(s));
    far = s - floor.dn > kFar * deviation || s > highest_dn;
    s += kCurveStep * deviation;
  }
  // Further on it is the curve itself.
  if (variance.is_affine())
    return VarianceCurve::table(std::move(signal), std::move(shown), variance.slope_dn());
  constexpr int kKnots = 512;
  const double from = signal.back(), step = (std::max(highest_dn, 2 * from) - from) / kKnots;
  for (int i = 1; i <= kKnots; ++i) {
    signal.push_back(from + i * step);
    shown.push_back(variance(signal.back()));
  }
  const double top = signal.back();
  return VarianceCurve::table(std::move(signal), std::move(shown),
                              variance(top + 1.0) - variance(top));
}

ChannelProfile channel_before_clipping(const ChannelProfile& channel, LowestCode floor) {
  const VarianceCurve shown = channel.variance.temporal();
  const double dark_dn2 = shown(0);
  const MeanAndVariance before = moments_before_clipping({channel.bias_dn, dark_dn2}, floor);
  if (!(before.variance_dn2 > dark_dn2)) return channel;
  ChannelProfile restored = channel;
  restored.bias_dn = before.mean_dn;
  constexpr double kFarAway = 1e4;  // dark deviations: as far the dark counts no more
  const double far_dn = kFarAway * std::sqrt(dark_dn2);
  restored.variance =
      VarianceCurve::affine((shown(far_dn) - dark_dn2) / far_dn, before.variance_dn2)
          .with_pattern(channel.variance.prnu(), channel.variance.dsnu_dn());
  restored.law.reset();
  return restored;
}

ChannelProfile clipped_channel(const ChannelProfile& channel, LowestCode floor, double highest_dn) {
  ChannelProfile clipped = channel;
  clipped.variance = clipped_variance(channel.variance, floor, highest_dn);
  clipped.law = NoiseLaw::clipped(channel.variance, floor.dn, floor.step_dn);
  return clipped;
}

}  // namespace malus
