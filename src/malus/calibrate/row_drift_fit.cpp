#include "malus/calibrate/internal/row_drift_fit.h"

#include "malus/base/golden_section.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include <Eigen/Dense>
#include <fmt/format.h>

namespace malus {
namespace {

using Values = std::vector<double>;

constexpr std::size_t kLeastFrames = 2, kLeastGroups = 32;
constexpr double kShortest = 0.5;  // row groups: below, slow and white part look alike
// Lengths of the longest drift in a frame's height: of a longer one a frame shows a slope whatever
// its length and share, and the rest is the frames' levels'.
constexpr double kLengthsInFrame = 4;

// Offsets of every phase about its own level in each frame, over its deviation in all of them.
struct Standardised {
  FrameSeries frames;
  double explained = 0;  ///< variance that pixel noise explains, in units of the frames' own
};

Standardised standardised(const FrameSeries& offsets_dn, const Values& explained_dn2) {
  const std::size_t phases = explained_dn2.size();
  const std::size_t groups = offsets_dn.front().size() / phases * phases;
  const auto in_phase = static_cast<double>(groups / phases);
  Standardised out;
  Values square(phases, 0.0);
  for (const Values& frame : offsets_dn) {
    Values y(frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(groups));
    Values mean(phases, 0.0);
    for (std::size_t g = 0; g < groups; ++g) mean[g % phases] += y[g] / in_phase;
    for (std::size_t g = 0; g < groups; ++g) {
      y[g] -= mean[g % phases];
      square[g % phases] += y[g] * y[g];
    }
    out.frames.push_back(std::move(y));
  }
  const double samples = in_phase * static_cast<double>(offsets_dn.size());
  for (std::size_t p = 0; p < phases; ++p)
    out.explained += explained_dn2[p] / (square[p] / samples) / static_cast<double>(phases);
  for (Values& frame : out.frames)
    for (std::size_t g = 0; g < groups; ++g) frame[g] /= std::sqrt(square[g % phases] / samples);
  return out;
}

// Mean periodogram at the frequencies that the levels' removal has left as they were.
struct Spectrum {
  std::size_t groups = 0;
  Values frequency;  ///< radians per row group
  Values power;      ///< of unit variance if white
};

Spectrum mean_spectrum(const FrameSeries& frames, std::size_t phases) {
  const std::size_t n = frames.front().size();
  Values covariance(n, 0.0);
  for (const Values& y : frames)
    for (std::size_t g = 0; g < n; ++g) {
      const double weighted = y[g] / static_cast<double>(n * frames.size());
      for (std::size_t lag = 0; lag < n - g; ++lag) covariance[lag] += weighted * y[g + lag];
    }
  Values cosine(n);
  for (std::size_t i = 0; i < n; ++i)
    cosine[i] = std::cos(2 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(n));
  Spectrum out;
  out.groups = n;
  for (std::size_t j = 1; 2 * j < n; ++j) {
    if (j * phases % n == 0) continue;
    double power = covariance[0];
    for (std::size_t lag = 1; lag < n; ++lag) power += 2 * covariance[lag] * cosine[j * lag % n];
    out.frequency.push_back(2 * std::numbers::pi * static_cast<double>(j) / static_cast<double>(n));
    out.power.push_back(power);
  }
  return out;
}

// Expected periodogram of a first-order autoregressive series of variance 1, the geometric sums of
// 1 + 2 sum (1 - k/n) decay^k cos(k w) written out.
Values slow_spectrum(const Spectrum& spectrum, double length) {
  const double decay = std::exp(-1.0 / length), n = static_cast<double>(spectrum.groups);
  const double last = std::pow(decay, n);
  Values power;
  for (const double w : spectrum.frequency) {
    const std::complex<double> z = decay * std::polar(1.0, w), rest = 1.0 - z;
    const auto plain = (z - last) / rest;
    const auto weighted = (z - n * last + (n - 1) * last * z) / (rest * rest);
    power.push_back(1.0 + 2.0 * std::real(plain - weighted / n));
  }
  return power;
}

// The likeliest variance of the series for a slow share.
double best_variance(const Spectrum& spectrum, const Values& slow, double share) {
  double sum = 0;
  for (std::size_t j = 0; j < slow.size(); ++j)
    sum += spectrum.power[j] / (1.0 + share * (slow[j] - 1.0));
  return sum / static_cast<double>(slow.size());
}

// Minus log likelihood per frame of a slow share with that variance.
double deviance(const Spectrum& spectrum, const Values& slow, double share) {
  double logarithms = 0;
  for (const double power : slow) logarithms += std::log(1.0 + share * (power - 1.0));
  return static_cast<double>(slow.size()) * std::log(best_variance(spectrum, slow, share)) +
         logarithms;
}

constexpr int kSections = 40;  // of a golden-section search

struct Fit {
  double length = 0, share = 0, deviance = 0;
};

Fit best_share(const Spectrum& spectrum, double length) {
  const Values slow = slow_spectrum(spectrum, length);
  const auto of = [&](double share) { return deviance(spectrum, slow, share); };
  const double share = golden_section_minimum(of, 0.0, 1.0, kSections);
  return {length, share, of(share)};
}

Fit best_fit(const Spectrum& spectrum) {
  constexpr int kSteps = 20;
  const double low = std::log(kShortest);
  const double high =
      std::log(std::min(kLongestRowDrift, static_cast<double>(spectrum.groups) / kLengthsInFrame));
  const double step = (high - low) / kSteps;
  int best = 0;
  double least = best_share(spectrum, kShortest).deviance;
  for (int i = 1; i <= kSteps; ++i) {
    const double found = best_share(spectrum, std::exp(low + i * step)).deviance;
    if (found < least) least = found, best = i;
  }
  const double log_length = golden_section_minimum(
      [&](double x) { return best_share(spectrum, std::exp(x)).deviance; },
      std::max(low, low + (best - 1) * step), std::min(high, low + (best + 1) * step), kSections);
  return best_share(spectrum, std::exp(log_length));
}

// Covariance of share's and length's errors from Whittle's information, the variance estimated too.
Eigen::Matrix2d error_covariance(const Spectrum& spectrum, const Fit& fit, int frames) {
  constexpr double kStep = 1e-3;  // of ln length
  const Values slow = slow_spectrum(spectrum, fit.length);
  const Values longer = slow_spectrum(spectrum, fit.length * std::exp(kStep));
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  for (std::size_t j = 0; j < slow.size(); ++j) {
    const double shape = 1.0 + fit.share * (slow[j] - 1.0);
    const Eigen::Vector3d slope(1.0, (slow[j] - 1.0) / shape,
                                fit.share * (longer[j] - slow[j]) / (kStep * fit.length) / shape);
    information += frames * slope * slope.transpose();
  }
  return information.inverse().bottomRightCorner<2, 2>();
}

// Mean over n groups of one channel of the sum over those of another.
template <class Function>
double lag_sum(const RowDrift& drift, int n, int stride, int shift, const Function& of) {
  if (drift.white()) return 0.0;
  double sum = 0;
  for (int k = 1 - n; k < n; ++k) {
    const int lag = std::abs(k * stride + shift);
    if (lag > 0)
      sum += (1.0 - std::abs(k) / static_cast<double>(n)) * of(row_autocorrelation(drift, lag));
  }
  return sum;
}

}  // namespace

Estimate<FittedRowDrift> fit_row_drift(const FrameSeries& offsets_dn, const Values& explained_dn2,
                                       int independent_frames, double least_evidence) {
  MALUS_REQUIRE(!offsets_dn.empty() && !explained_dn2.empty());
  if (offsets_dn.size() < kLeastFrames || offsets_dn.front().size() < kLeastGroups)
    return Undecided{fmt::format("{} frames of {} row groups; {} of {} are needed",
                                 offsets_dn.size(), offsets_dn.front().size(), kLeastFrames,
                                 kLeastGroups)};
  const Standardised rows = standardised(offsets_dn, explained_dn2);
  if (!(rows.explained < 0.95))
    return Undecided{"too little row noise beyond what pixel noise explains"};
  const Spectrum spectrum = mean_spectrum(rows.frames, explained_dn2.size());
  const Fit fit = best_fit(spectrum);
  const double white = deviance(spectrum, Values(spectrum.power.size(), 1.0), 0.0);
  const double evidence = 2.0 * independent_frames * (white - fit.deviance);
  if (!(evidence > least_evidence))
    return Undecided{fmt::format("2 ln L = {:.1f} against white rows; {:.0f} are needed", evidence,
                                 least_evidence)};
  const Eigen::Matrix2d errors = error_covariance(spectrum, fit, independent_frames);
  // The likeliest variance holds what slow waves give to the frames' means; beyond the pixels' part
  // of it lies the rows'.
  const double variance = best_variance(spectrum, slow_spectrum(spectrum, fit.length), fit.share);
  const double of_rows = variance / (variance - rows.explained);
  return FittedRowDrift{{{std::min(fit.share * of_rows, 1.0), fit.length},
                         std::sqrt(std::max(errors(0, 0), 0.0)) * of_rows,
                         std::sqrt(std::max(errors(1, 1), 0.0))},
                        errors(0, 1) * of_rows,
                        evidence};
}

double drift_of_means(const RowDrift& drift, int n, int stride, int shift) {
  return lag_sum(drift, n, stride, shift, [](double rho) { return rho; });
}

double drift_of_means_stderr(const FittedRowDrift& fitted, int n, int stride) {
  if (fitted.drift.white()) return 0.0;
  constexpr double kStep = 1e-3;  // of the length
  RowDrift longer = fitted.drift;
  longer.length_groups *= 1.0 + kStep;
  const double sum = drift_of_means(fitted.drift, n, stride, 0);
  const double by_share = sum / fitted.drift.share;
  const double by_length =
      (drift_of_means(longer, n, stride, 0) - sum) / (kStep * fitted.drift.length_groups);
  const double share = by_share * fitted.share_stderr, length = by_length * fitted.length_stderr;
  return std::sqrt(std::max(
      share * share + length * length + 2.0 * by_share * by_length * fitted.share_length_covariance,
      0.0));
}

double drift_of_variances(const RowDrift& drift, int n, int stride, int shift) {
  return lag_sum(drift, n, stride, shift, [](double rho) { return rho * rho; });
}

}  // namespace malus
