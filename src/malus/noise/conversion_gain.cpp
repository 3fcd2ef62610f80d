// Steps from gain to gain: breaks between conversion gains, and gaps too wide to look into.
#include "malus/noise/joint_gain.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace malus {
namespace {

struct SlopeRange {
  double low, high;
  void include(double slope) {
    low = std::min(low, slope);
    high = std::max(high, slope);
  }
};

// How far the step from i to i+1 departs from the slopes of its neighbours, or from `physical`
// where one of them is missing. NaN, which is above no limit, where y is not known at an end: read
// noise that the converter's step hides is not finite.
double excess(std::span<const double> x, std::span<const double> y, std::size_t i,
              SlopeRange physical) {
  const auto slope = [&](std::size_t k) { return (y[k + 1] - y[k]) / (x[k + 1] - x[k]); };
  const bool left = i > 0 && std::isfinite(slope(i - 1)),
             right = i + 2 < x.size() && std::isfinite(slope(i + 1));
  if (!std::isfinite(slope(i))) return std::numeric_limits<double>::quiet_NaN();
  SlopeRange allowed = left && right ? SlopeRange{slope(i - 1), slope(i - 1)} : physical;
  if (left) allowed.include(slope(i - 1));
  if (right) allowed.include(slope(i + 1));
  return std::max(allowed.low - slope(i), slope(i) - allowed.high) * (x[i + 1] - x[i]);
}

// By how much the law between knots k and k+1 exceeds, in the middle, noise before and after the
// amplifier that adds in squares: x² = a + b K² through both; 0 where that has no such a and b.
double excess_of_law(const LogLinear& law, const JointSegment& segment, std::size_t k) {
  if (law.signed_linear) return 0;
  const auto square = [&](std::size_t i) {
    const double x = law.at(segment.knots_log_K[i], segment.knots_db, segment.knots_db[i]);
    return x * x;
  };
  const double ratio2 = std::exp(segment.knots_log_K[k + 1] - segment.knots_log_K[k]);  // of middle
  const double low2 = square(k), high2 = square(k + 1);
  if (!(high2 > low2) || high2 > low2 * ratio2 * ratio2) return 0;
  return std::sqrt(std::sqrt(low2 * high2) / (low2 + (high2 - low2) / (ratio2 + 1))) - 1;
}

}  // namespace

std::vector<int> conversion_gain_breaks(std::span<const double> gain_db,
                                        std::span<const double> log_K,
                                        std::span<const double> log_read_noise_dn) {
  const double limit = std::log(kBreakFactor);
  std::vector<int> breaks;
  for (std::size_t i = 0; i + 1 < gain_db.size(); ++i) {
    const bool read_jumps = excess(log_K, log_read_noise_dn, i, {0.0, 1.0}) > limit;
    const bool K_jumps = excess(gain_db, log_K, i, {kLogPerDb, kLogPerDb}) > limit;
    if (read_jumps || K_jumps) breaks.push_back(static_cast<int>(i));
  }
  return breaks;
}

std::vector<std::string> wide_gap_notes(const JointSegment& segment,
                                        std::span<const std::string> gain_names) {
  constexpr double kVisible = 0.15;
  std::vector<std::string> notes;
  for (std::size_t k = 0; k + 1 < segment.knots_db.size(); ++k) {
    double most = 0;
    for (const LogLinear& law : segment.sigma_tl)
      most = std::max(most, excess_of_law(law, segment, k));
    if (most > kVisible)
      notes.push_back(fmt::format(
          "between {} and {} nothing was measured: the law's read noise there may be up to "
          "{:.0f} % too large (noise before and after the amplifier adds in squares); calibrate at "
          "a gain in between",
          gain_names[k], gain_names[k + 1], 100 * most));
  }
  return notes;
}

}  // namespace malus
