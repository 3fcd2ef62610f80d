#include "malus/calibrate/internal/rounded_noise.h"

#include "malus/base/index.h"
#include "malus/base/normal_distribution.h"
#include "malus/noise/rounding.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include <Eigen/Dense>
#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kReach = CodePairs::kReach, kCodes = CodePairs::kCodes;
// Pixels of no normal offset (hot ones): they keep their code, whichever it is.
constexpr double kOddPixels = 1e-4;
constexpr double kNarrowestPattern = 0.02, kNarrowestNoise = 0.02;  // codes
constexpr double kMostError = 0.25, kFewestChanges = 40.0;

// Mean offset in codes, logarithms of the offsets' and of the noise's deviation.
using Parameters = Eigen::Vector3d;
using PairChances = std::array<double, kCodes * kCodes>;

// Chance of every pair of codes, of which the lowest has no lower end: the offsets by trapezoids,
// narrower than the noise.
PairChances chances_of(const Parameters& p, int lowest) {
  constexpr double kWidest = 5.0, kPerNoise = 3.0;
  const double pattern = std::exp(p[1]), noise = std::exp(p[2]);
  const int nodes =
      std::clamp(static_cast<int>(2 * kWidest * pattern * kPerNoise / noise), 20, 600);
  PairChances chances{};
  double total = 0.0;
  for (int i = 0; i <= nodes; ++i) {
    const double x = kWidest * (2.0 * i / nodes - 1.0), weight = std::exp(-0.5 * x * x);
    total += weight;
    std::array<double, kCodes> one{};
    double last = 0.0;
    for (int k = kReach + lowest; k < kCodes; ++k) {
      const double next = normal_cdf((k - kReach + 0.5 - p[0] - pattern * x) / noise);
      one[as_index(k)] = next - last;
      last = next;
    }
    for (int a = 0; a < kCodes; ++a)
      for (int b = 0; b < kCodes; ++b)
        chances[as_index(a * kCodes + b)] += weight * one[as_index(a)] * one[as_index(b)];
  }
  for (int a = 0; a < kCodes; ++a)
    for (int b = 0; b < kCodes; ++b) {
      double& chance = chances[as_index(a * kCodes + b)];
      chance = (1 - kOddPixels) * chance / total + (a == b ? kOddPixels / kCodes : 1e-15);
    }
  return chances;
}

double likelihood_of(const CodePairs& pairs, const Parameters& p) {
  const PairChances chances = chances_of(p, pairs.lowest);
  double sum = 0.0;
  for (std::size_t i = 0; i < chances.size(); ++i)
    if (pairs.count[i] > 0) sum += pairs.count[i] * std::log(chances[i]);
  return sum;
}

// Slope of the log-likelihood and its expected curvature (Fisher's information).
struct Ascent {
  Eigen::Vector3d slope = Eigen::Vector3d::Zero();
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
};

Ascent ascent_at(const CodePairs& pairs, double total, const Parameters& p) {
  constexpr double kDelta = 1e-4;
  const PairChances here = chances_of(p, pairs.lowest);
  std::array<PairChances, 3> slope;
  for (int j = 0; j < 3; ++j) {
    Parameters up = p, down = p;
    up[j] += kDelta;
    down[j] -= kDelta;
    const PairChances high = chances_of(up, pairs.lowest), low = chances_of(down, pairs.lowest);
    for (std::size_t i = 0; i < here.size(); ++i)
      slope[as_index(j)][i] = (high[i] - low[i]) / (2 * kDelta);
  }
  Ascent out;
  for (std::size_t i = 0; i < here.size(); ++i) {
    const Eigen::Vector3d by(slope[0][i], slope[1][i], slope[2][i]);
    out.slope += pairs.count[i] / here[i] * by;
    out.information += total / here[i] * by * by.transpose();
  }
  return out;
}

Parameters within_bounds(Parameters p) {
  p[0] = std::clamp(p[0], -static_cast<double>(kReach), static_cast<double>(kReach));
  p[1] = std::clamp(p[1], std::log(kNarrowestPattern), std::log(static_cast<double>(kReach)));
  p[2] = std::clamp(p[2], std::log(kNarrowestNoise), std::log(static_cast<double>(kReach)));
  return p;
}

Parameters best_start(const CodePairs& pairs, double mean) {
  Parameters best;
  double most = -std::numeric_limits<double>::infinity();
  for (const double noise : {0.08, 0.14, 0.22, 0.32, 0.5})
    for (const double pattern : {0.03, 0.15, 0.4, 1.0, 2.0}) {
      const Parameters start(mean, std::log(pattern), std::log(noise));
      const double value = likelihood_of(pairs, start);
      if (value > most) {
        most = value;
        best = start;
      }
    }
  return best;
}

// Fisher scoring, damped where a step does not climb (Levenberg). with_pattern: else that stays.
Parameters climbed(const CodePairs& pairs, double total, Parameters p, bool with_pattern = true) {
  double value = likelihood_of(pairs, p), damping = 1e-3;
  for (int iteration = 0; iteration < 60; ++iteration) {
    Ascent at = ascent_at(pairs, total, p);
    if (!with_pattern) {
      at.slope[1] = 0;
      at.information.row(1).setZero();
      at.information.col(1).setZero();
    }
    bool better = false;
    double gained = 0.0;
    for (int trial = 0; trial < 8 && !better; ++trial) {
      Eigen::Matrix3d matrix = at.information;
      matrix.diagonal() *= 1.0 + damping;
      matrix.diagonal().array() += 1e-9 * matrix.trace();
      const Eigen::Vector3d step = matrix.ldlt().solve(at.slope);
      const Parameters next =
          within_bounds(p + step / std::max(step.cwiseAbs().maxCoeff() / 0.3, 1.0));
      const double found = likelihood_of(pairs, next);
      better = found > value;
      damping = better ? damping / 3 : damping * 10;
      if (!better) continue;
      gained = found - value;
      value = found;
      p = next;
    }
    if (!better || gained < 1e-4) break;
  }
  return p;
}

bool shows_pattern(const Parameters& p) { return std::exp(p[1]) > 2 * kNarrowestPattern; }

// Variances of the parameters, of deviations relative ones; without the pattern where there is none
// to speak of.
Eigen::Vector3d errors2(const Eigen::Matrix3d& information, const Parameters& p) {
  if (shows_pattern(p)) return information.inverse().diagonal();
  Eigen::Matrix2d two;
  two << information(0, 0), information(0, 2), information(2, 0), information(2, 2);
  const Eigen::Vector2d errors = two.inverse().diagonal();
  return {errors[0], 0.0, errors[1]};
}

// Two standard errors of a pattern that does not show, and what it makes one of the noise,
// relative: the widest that is not two standard errors off would leave so much less noise, and that
// is two errors of the noise.
struct UnseenPattern {
  double widest, noise_error;
};
UnseenPattern unseen_pattern(const CodePairs& pairs, double total, const Parameters& best) {
  constexpr double kErrors = 2.0, kFiner = 1.3;
  const double least =
      likelihood_of(pairs, best) - 0.5 * kErrors * kErrors * std::max(pairs.per_pixel, 1.0);
  double widest = best[1], narrowest = best[2];
  Parameters p = best;
  for (p[1] += std::log(kFiner); p[1] < std::log(0.5); p[1] += std::log(kFiner)) {
    p = climbed(pairs, total, p, false);
    if (likelihood_of(pairs, p) < least) break;
    widest = p[1];
    narrowest = std::min(narrowest, p[2]);
  }
  return {std::exp(widest), (1.0 - std::exp(narrowest - best[2])) / kErrors};
}

// Density of the pixels' values at the boundaries between codes, all in codes (Stein's lemma: that
// is how the rounded value follows a normal part of them).
double slope_of(double mean, double deviation, int lowest) {
  double slope = 0.0;
  for (int k = lowest; k < kReach; ++k) slope += normal_density((k + 0.5 - mean) / deviation);
  return slope / deviation;
}

// Standard error of that slope, by those of the fit.
double slope_error(const RoundedNoise& fit, int lowest) {
  const double deviation = std::hypot(fit.sd, fit.pattern_sd);
  const double error =
      std::hypot(fit.sd * fit.stderr_of_sd, fit.pattern_sd * fit.stderr_of_pattern_sd) / deviation;
  const double by_mean = slope_of(fit.mean + fit.stderr_of_mean, deviation, lowest) -
                         slope_of(fit.mean - fit.stderr_of_mean, deviation, lowest);
  const double by_deviation =
      slope_of(fit.mean, deviation + error, lowest) -
      slope_of(fit.mean, std::max(deviation - error, 0.5 * deviation), lowest);
  return 0.5 * std::hypot(by_mean, by_deviation);
}

// Variance over offsets of such a deviation of what rounding adds to their mean codes, in codes.
double variance_left(double mean, double pattern, double noise, int lowest) {
  constexpr double kWidest = 4.0, kPerCode = 20.0;
  const int nodes = std::max(static_cast<int>(2 * kWidest * pattern * kPerCode), 80);
  double total = 0, sum = 0, squares = 0;
  for (int i = 0; i <= nodes; ++i) {
    const double x = kWidest * (2.0 * i / nodes - 1.0), weight = std::exp(-0.5 * x * x);
    const double offset = mean + pattern * x, apart = offset - std::round(offset);
    const int least = std::max(-kReach, lowest - static_cast<int>(std::round(offset)));
    double code = least;
    for (int k = least; k < kReach; ++k) code += normal_cdf((apart - k - 0.5) / noise);
    const double left = code - apart;
    total += weight;
    sum += weight * left;
    squares += weight * left * left;
  }
  return squares / total - (sum / total) * (sum / total);
}

// Variance over the mean's place in a code of what rounding adds to the mean of normal values of
// this deviation, in codes: of the first harmonic, which is most of it.
double mean_doubt(double deviation) {
  constexpr double kPi = std::numbers::pi;
  return std::exp(-4 * kPi * kPi * deviation * deviation) / (2 * kPi * kPi);
}

double error_of_variance_left(const RoundedNoise& fit, int lowest) {
  const double least = std::max(fit.pattern_sd - fit.stderr_of_pattern_sd, 0.0);
  const double by_pattern =
      variance_left(fit.mean, fit.pattern_sd + fit.stderr_of_pattern_sd, fit.sd, lowest) -
      variance_left(fit.mean, least, fit.sd, lowest);
  const double by_noise =
      variance_left(fit.mean, fit.pattern_sd, fit.sd + fit.stderr_of_sd, lowest) -
      variance_left(fit.mean, fit.pattern_sd, std::max(fit.sd - fit.stderr_of_sd, 0.5 * fit.sd),
                    lowest);
  return 0.5 * std::hypot(by_pattern, by_noise);
}

// Temporal variance of codes that nothing cuts off.
double codes_variance(const RoundedNoise& fit) {
  const Parameters p(fit.mean, std::log(std::max(fit.pattern_sd, kNarrowestPattern)),
                     std::log(fit.sd));
  const PairChances chances = chances_of(p, -kReach);
  double sum = 0.0;
  for (int a = 0; a < kCodes; ++a)
    for (int b = 0; b < kCodes; ++b)
      sum += 0.5 * (a - b) * (a - b) * chances[as_index(a * kCodes + b)];
  return sum;
}

// Changes across the boundary between two codes that is crossed second most often.
double second_boundary(const CodePairs& pairs) {
  std::array<double, kCodes - 1> crossed{};
  for (int a = 0; a < kCodes; ++a)
    for (int b = 0; b < kCodes; ++b)
      for (int k = std::min(a, b); k < std::max(a, b); ++k)
        crossed[as_index(k)] += pairs.count[as_index(a * kCodes + b)];
  std::nth_element(crossed.begin(), crossed.begin() + 1, crossed.end(), std::greater<>());
  return crossed[1];
}

}  // namespace

CodePairCounter::CodePairCounter(const MosaicGeometry& geometry, double step_dn)
    : geometry_(geometry), step_dn_(step_dn), pairs_(as_index(geometry.channels())) {}

int CodePairCounter::code(float dn, int channel) const {
  const double steps = (static_cast<double>(dn) - origin_dn_) / step_dn_;
  constexpr double kFar = 1e6;
  return static_cast<int>(std::lround(std::clamp(steps, -kFar, kFar))) - middle_[as_index(channel)];
}

double CodePairCounter::usual_code_dn(int channel) const {
  return origin_dn_ + step_dn_ * middle_[as_index(channel)];
}

void CodePairCounter::end_at(double floor_dn, int channel) {
  if (!(step_dn_ > 0)) return;
  pairs_[as_index(channel)].lowest =
      std::clamp(code(static_cast<float>(floor_dn), channel), -CodePairs::kReach, 0);
}

void CodePairCounter::find_middle(View<const float> dn) {
  origin_dn_ = static_cast<double>(dn(0, 0));
  middle_.assign(as_index(geometry_.channels()), 0);
  std::vector<std::vector<int>> codes(middle_.size());
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c)
      codes[as_index(geometry_.channel(r, c))].push_back(code(dn(r, c), geometry_.channel(r, c)));
  for (std::size_t c = 0; c < codes.size(); ++c) {
    const auto middle = codes[c].begin() + static_cast<std::ptrdiff_t>(codes[c].size() / 2);
    std::nth_element(codes[c].begin(), middle, codes[c].end());
    middle_[c] = *middle;
  }
}

void CodePairCounter::add(View<const float> dn) {
  if (!(step_dn_ > 0)) return;
  const bool first = previous_.empty();
  for (CodePairs& pairs : pairs_) pairs.per_pixel += first ? 0.0 : 1.0;
  if (first) {
    find_middle(dn);
    previous_ = Image(dn.rows(), dn.cols());
  }
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c) {
      const int channel = geometry_.channel(r, c);
      const int a = first ? kReach + 1 : code(previous_(r, c), channel),
                b = code(dn(r, c), channel);
      if (std::abs(a) <= kReach && std::abs(b) <= kReach) pairs_[as_index(channel)].at(a, b) += 1.0;
      previous_(r, c) = dn(r, c);
    }
}

bool HiddenNoise::rounds_alike(double apart_dn) const {
  constexpr double kSteps = 0.1;
  return std::abs(apart_dn) < kSteps * std::sqrt(12.0 * rounding_dn2);
}

// Of normal values of deviation s at m, in codes, rounding makes s² + 1/12 - (4 s² + 1/π²)
// exp(-2π² s²) cos(2π m), to first order; the offsets spread m.
double HiddenNoise::variance_doubt_dn2(double shown_dn2) const {
  constexpr double kPi2 = std::numbers::pi * std::numbers::pi;
  constexpr double kWidest = 0.75 * 0.75;  // of 1e-5 and less
  const double step2 = 12.0 * rounding_dn2;
  if (!(step2 > 0)) return 0.0;
  const double noise = std::max(shown_dn2 - rounding_dn2, 0.0) / step2,
               offsets = dsnu_dn * dsnu_dn / step2;
  if (noise + offsets > kWidest) return 0.0;
  return step2 * (4 * noise + 1 / kPi2) * std::exp(-2 * kPi2 * (noise + offsets)) / std::sqrt(2.0);
}

HiddenNoise hidden_noise(const CodePairs& pairs, double codes_variance_dn2, double step_dn) {
  // Noise on a boundary has up to a quarter of q² however narrow.
  constexpr double kMostOfCodes = 0.3, kLimit = kLeastDarkVariance - 1.0 / 12.0;
  const double step2 = step_dn * step_dn;
  HiddenNoise out;
  out.limit_dn2 = kLimit * step2;
  out.rounding_dn2 = step2 / 12.0;
  out.widest_codes_dn2 = kMostOfCodes * step2;
  if (!(step_dn > 0) || !(codes_variance_dn2 < kMostOfCodes * step2)) return out;
  const auto fit = fit_rounded_noise(pairs);
  if (fit && fit->sd * fit->sd > kLimit) return out;
  out.hidden = true;
  if (fit) {
    out.variance_dn2 = fit->sd * fit->sd * step2;
    out.variance_stderr_dn2 = 2 * fit->sd * fit->stderr_of_sd * step2;
    out.mean_dn = fit->mean * step_dn;
    out.mean_stderr_dn = fit->stderr_of_mean * step_dn;
    out.dsnu_dn = fit->pattern_sd * step_dn;
    out.dsnu_stderr_dn = fit->stderr_of_pattern_sd * step_dn;
    out.slope = slope_of(fit->mean, std::hypot(fit->sd, fit->pattern_sd), pairs.lowest);
    out.slope_stderr = slope_error(*fit, pairs.lowest);
    out.left_dn2 = variance_left(fit->mean, fit->pattern_sd, fit->sd, pairs.lowest) * step2;
    out.left_stderr_dn2 = error_of_variance_left(*fit, pairs.lowest) * step2;
    out.mean_doubt_dn2 = mean_doubt(std::hypot(fit->sd, fit->pattern_sd)) * step2;
    out.codes_dn2 = codes_variance(*fit) * step2;
    return out;
  }
  // Anywhere from 0 to the limit.
  out.variance_dn2 = 0.5 * kLimit * step2;
  out.variance_stderr_dn2 = kLimit / std::sqrt(12.0) * step2;
  out.mean_doubt_dn2 = out.rounding_dn2;
  out.left_dn2 = 0.5 * out.rounding_dn2;
  out.left_stderr_dn2 = out.rounding_dn2 / std::sqrt(12.0);
  out.unknown = fit.reason();
  return out;
}

Estimate<RoundedNoise> fit_rounded_noise(const CodePairs& pairs) {
  double total = 0.0, mean = 0.0, equal = 0.0;
  for (int a = 0; a < kCodes; ++a)
    for (int b = 0; b < kCodes; ++b) {
      const double count = pairs.count[as_index(a * kCodes + b)];
      total += count;
      mean += 0.5 * (a + b - 2 * kReach) * count;
      if (a == b) equal += count;
    }
  if (!(total > equal)) return Undecided{"no pixel changes its code"};
  if (const double second = second_boundary(pairs); second < kFewestChanges)
    return Undecided{fmt::format(
        "pixels change between two codes alone ({:.0f} of {:.0f} changes cross another boundary)",
        second, total - equal)};
  const Parameters best = climbed(pairs, total, best_start(pairs, mean / total));
  // The pairs of one pixel share its offset and, in part, its frames: they count as one.
  const Eigen::Vector3d errors =
      (pairs.per_pixel * errors2(ascent_at(pairs, total, best).information, best)).cwiseSqrt();
  const bool shown = shows_pattern(best);
  const UnseenPattern unseen = shown ? UnseenPattern{} : unseen_pattern(pairs, total, best);
  const double noise = std::exp(best[2]), error = std::hypot(errors[2], unseen.noise_error);
  if (!(error < kMostError))
    return Undecided{fmt::format("{:.2g} codes ± {:.0f} %", noise, 100 * std::min(error, 9.99))};
  const double pattern = shown ? std::exp(best[1]) : 0.0;
  const double pattern_error = shown ? pattern * errors[1] : 0.5 * unseen.widest;
  return RoundedNoise{noise, noise * error, best[0], errors[0], pattern, pattern_error};
}

}  // namespace malus
