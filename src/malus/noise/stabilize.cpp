#include "malus/noise/stabilize.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

constexpr double kAnscombe = 3.0 / 8;  // of the squared slope in the root (Starck et al., 1998)
// In deviations. The curve's slope being K, a line between two knots of the inverse is K/16 times
// this squared too high: 1.6e-4 K.
constexpr double kInverseStep = 0.05;
constexpr double kMarginDeviations = 9.0;  // of the tables beyond the signals that occur
// Of the forward table: kLeastKnots at least, and more where steps would be wider than half a dark
// deviation (a white level nobody knows makes signals of 16 bits of them).
constexpr double kLeastKnots = 8192, kMostKnots = 65536, kKnotsPerDeviation = 2;
// Of the variances; the transformation holds them at 1 well below that many deviations.
constexpr double kVarianceStep = 0.25, kDarkDeviations = 20;

}  // namespace

Stabilizer::Stabilizer(const VarianceCurve& variance, double highest_dn)
    : Stabilizer(variance, highest_dn, NoiseLaw::gaussian(variance)) {}

Stabilizer::Stabilizer(const VarianceCurve& variance, double highest_dn, const NoiseLaw& law)
    : variance_(variance), floor_dn2_(std::pow(kLeastDeviation * highest_dn, 2)) {
  MALUS_REQUIRE(highest_dn > 0 && std::isfinite(highest_dn));
  if (variance_.is_affine()) {
    const double slope = variance_.slope_dn();
    const double offset = std::max(variance_.offset_dn2(), floor_dn2_);
    dark_deviation_dn_ = std::sqrt(offset + kAnscombe * slope * slope);
    negative_deviation_dn_ = std::sqrt(std::max(offset, std::pow(kLeastNegativeSlopes * slope, 2)));
  } else {
    dark_deviation_dn_ = std::sqrt(std::max(variance_(0.0), floor_dn2_));
    build_forward_table(highest_dn);
  }
  if (!is_straight()) build_inverse_table(highest_dn, law);
}

void Stabilizer::build_forward_table(double highest_dn) {
  const double top = highest_dn + kMarginDeviations * std::sqrt(variance_(highest_dn));
  const double dark_dn = std::sqrt(std::max(variance_(0.0), floor_dn2_));
  const auto knots =
      static_cast<int>(std::clamp(kKnotsPerDeviation * top / dark_dn, kLeastKnots, kMostKnots));
  signal_step_dn_ = top / knots;
  const auto rate = [&](double s) {
    const double slope = (variance_(s + signal_step_dn_) - variance_(s)) / signal_step_dn_;
    return 1.0 / std::sqrt(std::max(variance_(s), floor_dn2_) + kAnscombe * slope * slope);
  };
  dark_deviation_dn_ = 1.0 / rate(0.0);
  negative_deviation_dn_ = dark_dn;
  integral_.assign(1, 0.0);
  for (int i = 0; i < knots; ++i)
    integral_.push_back(integral_.back() +
                        signal_step_dn_ * rate((static_cast<double>(i) + 0.5) * signal_step_dn_));
}

double Stabilizer::forward(double dn) const {
  if (dn <= 0) return dn / negative_deviation_dn_;
  if (variance_.is_affine()) {
    const double slope = variance_.slope_dn();
    if (is_straight()) return dn / dark_deviation_dn_;
    // 2/K (sqrt(K s + b) - sqrt b), written without the difference of near equals.
    return 2.0 * dn /
           (std::sqrt(slope * dn + dark_deviation_dn_ * dark_deviation_dn_) + dark_deviation_dn_);
  }
  const double position = dn / signal_step_dn_;
  const std::size_t last = integral_.size() - 2;  // of NaN, too
  const auto i = position < static_cast<double>(last) ? static_cast<std::size_t>(position) : last;
  return integral_[i] + (position - static_cast<double>(i)) * (integral_[i + 1] - integral_[i]);
}

void Stabilizer::build_inverse_table(double highest_dn, const NoiseLaw& law) {
  // Knots of the expectation, evenly spaced in the stabilised domain, from below the darkest sample
  // to above the brightest one; then resampled on an even grid. Both hold the signal 0, where the
  // shot noise sets in and the expectation has a bend.
  std::vector<double> knots;
  const double top =
      highest_dn + kMarginDeviations * std::sqrt(std::max(variance_(highest_dn), floor_dn2_));
  constexpr int kBelow = static_cast<int>(kMarginDeviations / kInverseStep);
  for (int i = -kBelow; i < 0; ++i) knots.push_back(i * kInverseStep * dark_deviation_dn_);
  for (double s = 0; s < top;) {
    knots.push_back(s);
    const double deviation = std::sqrt(std::max(variance_(s), floor_dn2_));
    s += kInverseStep * std::max(deviation, dark_deviation_dn_);
  }
  std::vector<double> expected = expectations_at(knots, law);
  // Nothing is darker than no light. Of what is cut off the mean hardly falls below that, so means
  // that came out lower by chance would be far too dark: the inverse goes on straight.
  if (law.is_clipped())
    for (int i = 0; i < kBelow; ++i)
      expected[static_cast<std::size_t>(i)] =
          expected[kBelow] + knots[static_cast<std::size_t>(i)] / knots[kBelow + 1] *
                                 (expected[kBelow + 1] - expected[kBelow]);
  std::vector<double> mean, signal;
  for (std::size_t i = 0; i < knots.size(); ++i)
    if (mean.empty() || expected[i] > mean.back()) {  // rounding must not break the order
      mean.push_back(expected[i]);
      signal.push_back(knots[i]);
    }
  const double at_zero = expected[kBelow];
  inverse_low_ = at_zero - kInverseStep * std::floor((at_zero - mean.front()) / kInverseStep);
  std::size_t i = 0;
  for (double value = inverse_low_; value <= mean.back(); value += kInverseStep) {
    while (i + 2 < mean.size() && mean[i + 1] < value) ++i;
    const double t = (value - mean[i]) / (mean[i + 1] - mean[i]);
    signal_dn_.push_back(signal[i] + t * (signal[i + 1] - signal[i]));
  }
}

// The law's expectation of the curve at each knot. Of a variance that is one line, expectation and
// curve x differ by about 1/(4x) deviations where they are bright: the difference is worked out at
// knots that lie apart as x^1.5, as far as its bend allows, and interpolated, to 4e-6 deviations.
std::vector<double> Stabilizer::expectations_at(const std::vector<double>& knots,
                                                const NoiseLaw& law) const {
  constexpr double kBright = 20.0, kApart = 0.5;  // deviations; between knots there
  std::vector<std::size_t> at;
  std::vector<double> worked_out;
  double next = kBright;
  for (std::size_t i = 0; i < knots.size(); ++i) {
    const double x = forward(knots[i]);
    if (variance_.is_affine() && x >= kBright && x < next && i + 1 < knots.size()) continue;
    at.push_back(i);
    worked_out.push_back(knots[i]);
    if (x >= kBright) next = x + kApart * std::pow(x / kBright, 1.5);
  }
  worked_out = law.expectations([this](double dn) { return forward(dn); }, worked_out);
  std::vector<double> expected(knots.size());
  for (std::size_t k = 0; k < at.size(); ++k) expected[at[k]] = worked_out[k];
  for (std::size_t k = 0; k + 1 < at.size(); ++k) {
    const double low = worked_out[k] - forward(knots[at[k]]),
                 high = worked_out[k + 1] - forward(knots[at[k + 1]]);
    for (std::size_t i = at[k] + 1; i < at[k + 1]; ++i)
      expected[i] =
          forward(knots[i]) + low +
          (high - low) * static_cast<double>(i - at[k]) / static_cast<double>(at[k + 1] - at[k]);
  }
  return expected;
}

double Stabilizer::inverse(double stabilized) const {
  if (is_straight()) return stabilized * dark_deviation_dn_;
  const double position = (stabilized - inverse_low_) / kInverseStep;
  const double last = static_cast<double>(signal_dn_.size() - 2);
  const double cell = std::clamp(std::floor(position), 0.0, last);
  const auto i = static_cast<std::size_t>(cell);
  return signal_dn_[i] + (position - cell) * (signal_dn_[i + 1] - signal_dn_[i]);
}

double Stabilizer::mean_of(double signal_dn) const {
  if (is_straight()) return forward(signal_dn);
  // The cell of the inverse's table that holds the signal; the outer cells go on as straight lines.
  const auto above = std::upper_bound(signal_dn_.begin() + 1, signal_dn_.end() - 1, signal_dn);
  const auto i = static_cast<std::size_t>(above - signal_dn_.begin()) - 1;
  const double within = (signal_dn - signal_dn_[i]) / (signal_dn_[i + 1] - signal_dn_[i]);
  return inverse_low_ + (static_cast<double>(i) + within) * kInverseStep;
}

double Stabilizer::inverse_slope(double stabilized) const {
  return (inverse(stabilized + kInverseStep) - inverse(stabilized - kInverseStep)) /
         (2 * kInverseStep);
}

StabilizedVariance::StabilizedVariance(const Stabilizer& stabilizer, double highest_dn,
                                       const NoiseLaw& law)
    : dark_mean_(stabilizer.mean_of(0.0)) {
  std::vector<double> signals{stabilizer.is_straight() ? highest_dn : 0.0};
  for (double x = dark_mean_ + kVarianceStep; !stabilizer.is_straight() && x < kDarkDeviations;
       x += kVarianceStep)
    signals.push_back(stabilizer.inverse(x));
  const auto curve = [&](double dn) { return stabilizer.forward(dn); };
  const auto squared = [&](double dn) { return std::pow(stabilizer.forward(dn), 2); };
  const std::vector<double> mean = law.expectations(curve, signals);
  variances_ = law.expectations(squared, signals);
  for (std::size_t i = 0; i < signals.size(); ++i) variances_[i] -= mean[i] * mean[i];
}

double StabilizedVariance::at(double stabilized) const {
  if (variances_.size() < 2) return variances_.front();
  const double position = (stabilized - dark_mean_) / kVarianceStep;
  const auto last = static_cast<double>(variances_.size() - 1);
  const double within = std::clamp(position, 0.0, last);
  const auto i = std::min(static_cast<std::size_t>(within), variances_.size() - 2);
  return variances_[i] + (within - static_cast<double>(i)) * (variances_[i + 1] - variances_[i]);
}

}  // namespace malus
