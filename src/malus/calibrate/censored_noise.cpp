#include "malus/calibrate/internal/censored_noise.h"

#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace malus {
namespace {

constexpr double kFlattest = 1.0, kHeaviest = -0.4;  // λ

// Means over a Tukey-lambda variable of scale 1 of its distance above its p-quantile, to the
// powers 1 to 4; 0 below.
using Powers = std::array<double, 4>;

Powers powers_above(double lambda, double p) {
  constexpr int kParts = 400;
  Powers sum{};
  const double from = tukey_lambda_quantile(p, lambda);
  for (int i = 0; i < kParts; ++i) {
    const double t = (i + 0.5) / kParts;  // fine where the tail is long
    const double above = (1.0 - p) * std::pow(t, 4);
    const double weight = (1.0 - p) * 4.0 * std::pow(t, 3) / kParts;
    const double distance = -tukey_lambda_quantile(above, lambda) - from;
    for (double power = weight * distance; double& of : sum) {
      of += power;
      power *= distance;
    }
  }
  return sum;
}

// What a distribution shows: the share at the floor, and the first two of those means.
struct Statistics {
  double share = 0, first = 0, second = 0;
};

struct Law {
  double lambda = 0, scale_dn = 0, mean_dn = 0;
  bool found = false;
};

// The squared mean over the mean square falls with the weight of the tails.
Law law_of(const Statistics& shown, double below_dn) {
  constexpr int kHalvings = 40;
  const double wanted = shown.second / (shown.first * shown.first);
  const auto ratio = [&](double lambda) {
    const Powers powers = powers_above(lambda, shown.share);
    return powers[1] / (powers[0] * powers[0]);
  };
  double low = kHeaviest, high = kFlattest;
  if (!(ratio(low) > wanted && wanted > ratio(high))) return {};
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (ratio(middle) > wanted ? low : high) = middle;
  }
  Law law{low, shown.first / powers_above(low, shown.share)[0], 0, true};
  law.mean_dn = below_dn - law.scale_dn * tukey_lambda_quantile(shown.share, low);
  return law;
}

double variance_dn2(const Law& law) {
  return law.scale_dn * law.scale_dn * tukey_lambda_variance(law.lambda);
}

// Density at its share-quantile.
double density_at(const Law& law, double share) {
  const double slope = std::pow(share, law.lambda - 1.0) + std::pow(1.0 - share, law.lambda - 1.0);
  return 1.0 / (law.scale_dn * slope);
}

// Half a code above the floor everything is rounded to it. Codes stand for their middles, of which
// the mean square lacks a twelfth of a step squared, and the mean what the density falls by at that
// edge.
Statistics statistics_of(const ShownNoise& shown, double density_per_dn) {
  const double step = shown.step_dn, half = 0.5 * step, share = shown.zero_share;
  const double square = shown.variance_dn2 + shown.mean_dn * shown.mean_dn;
  return {share, shown.mean_dn - half * (1.0 - share) - density_per_dn * step * step / 12.0,
          square - step * shown.mean_dn + (half * half - step * step / 12.0) * (1.0 - share)};
}

// Of the statistics of one sample.
std::array<std::array<double, 3>, 3> covariance_of(const Law& law, const Statistics& shown) {
  const Powers unit = powers_above(law.lambda, shown.share);
  const double s = law.scale_dn, first = s * unit[0], second = s * s * unit[1],
               third = s * s * s * unit[2], fourth = s * s * s * s * unit[3], share = shown.share;
  const double share_first = -share * first, share_second = -share * second,
               both = third - first * second;
  return {{{share * (1.0 - share), share_first, share_second},
           {share_first, second - first * first, both},
           {share_second, both, fourth - second * second}}};
}

}  // namespace

CensoredNoise find_censored_noise(const ShownNoise& shown) {
  constexpr double kWidestStep = 0.8;  // deviations
  constexpr int kRounds = 6;           // of the density at the edge
  CensoredNoise out;
  if (!(shown.zero_share > 0) || shown.zero_share > kMostCensoredZeros || !(shown.variance_dn2 > 0))
    return out;
  const double edge_dn = 0.5 * shown.step_dn;
  Statistics statistics = statistics_of(shown, 0.0);
  Law law{kNormalLambda, statistics.first / powers_above(kNormalLambda, shown.zero_share)[0]};
  for (int round = 0; round < kRounds; ++round) {
    if (!(law.scale_dn > 0)) return out;
    statistics = statistics_of(shown, density_at(law, shown.zero_share));
    if (!(statistics.first > 0)) return out;
    law = law_of(statistics, edge_dn);
    if (!law.found) return out;
  }
  if (shown.step_dn > kWidestStep * std::sqrt(variance_dn2(law))) return out;
  const auto covariance = covariance_of(law, statistics);
  std::array<std::array<double, 3>, 3> slopes{};  // [statistic][mean, variance, lambda]
  constexpr double kStep = 1e-4;
  for (std::size_t i = 0; i < 3; ++i) {
    Statistics moved = statistics;
    double& value = i == 0 ? moved.share : i == 1 ? moved.first : moved.second;
    const double step = kStep * value;
    value += step;
    const Law other = law_of(moved, edge_dn);
    if (!other.found) return out;
    slopes[i] = {(other.mean_dn - law.mean_dn) / step,
                 (variance_dn2(other) - variance_dn2(law)) / step,
                 (other.lambda - law.lambda) / step};
  }
  const auto error = [&](std::size_t of) {
    double sum = 0;
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j) sum += slopes[i][of] * slopes[j][of] * covariance[i][j];
    return std::sqrt(std::max(sum, 0.0) / shown.samples);
  };
  // Codes k count with the density at k - 1/2: all of it above the floor, to second order.
  const double slope = tukey_lambda_cdf(law.mean_dn / law.scale_dn, law.lambda);
  return {law.mean_dn, error(0), variance_dn2(law), error(1), law.lambda, error(2), slope, true};
}

}  // namespace malus
