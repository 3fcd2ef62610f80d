// The compiled sampler against the numeric distribution and the plain definition at 1e8 samples:
// histogram divergence below twice its sampling floor, moments to fourth order, tails to 1e-6.
#include "malus/base/parallel.h"
#include "malus/noise/distribution.h"
#include "malus/synthesize/compiled.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "noise/pixel_expectation.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::expectation_of;

constexpr int kRows = 1000, kCols = 2000, kFrames = 50;  // 1e8 samples
constexpr double kSamples = 1.0 * kRows * kCols * kFrames;

struct Case {
  const char* name;
  PhysicsChannel channel;
  double signal_dn;
};

// Power sums about the true mean, in units of the true sd, and counts in bins and tails.
struct Counts {
  std::array<double, 9> power{};
  std::vector<double> bins, below, above;
};

struct Truth {
  double mean = 0, sd = 0;
  std::vector<double> edges;                   ///< bins between them; outside left out
  std::vector<double> tail_below, tail_above;  ///< quantiles of kTails and 1 - kTails
};
constexpr std::array<double, 4> kTails{1e-6, 1e-5, 1e-4, 1e-2};

Truth truth_of(const PixelDistribution& distribution) {
  Truth truth;
  truth.mean = distribution.mean_dn();
  truth.sd = std::sqrt(distribution.variance_dn2());
  for (int i = 0; i <= 240; ++i) truth.edges.push_back(truth.mean + truth.sd * (i - 120) / 20.0);
  for (const double p : kTails) {
    truth.tail_below.push_back(distribution.quantile(p));
    truth.tail_above.push_back(distribution.quantile(1 - p));
  }
  return truth;
}

void count(const Image& noisy, const Truth& truth, Counts& counts) {
  const double scale =
      static_cast<double>(truth.edges.size() - 1) / (truth.edges.back() - truth.edges.front());
  for (const float v : noisy.values()) {
    const double x = (static_cast<double>(v) - truth.mean) / truth.sd;
    double power = 1;
    for (double& sum : counts.power) {
      sum += power;
      power *= x;
    }
    const double bin = (static_cast<double>(v) - truth.edges.front()) * scale;
    if (bin >= 0 && bin < static_cast<double>(counts.bins.size()))
      counts.bins[static_cast<std::size_t>(bin)] += 1;
    for (std::size_t i = 0; i < kTails.size(); ++i) {
      counts.below[i] += static_cast<double>(v) < truth.tail_below[i];
      counts.above[i] += static_cast<double>(v) > truth.tail_above[i];
    }
  }
}

Counts draw(const Case& c, const Truth& truth, std::uint64_t seed) {
  PhysicsNoise noise;
  noise.layout = SensorLayout::named("mono");
  noise.channels = {c.channel};
  const CompiledNoise compiled(noise);
  const Image clean(kRows, kCols, static_cast<float>(c.signal_dn));
  std::vector<Counts> frames(kFrames);
  parallel_for(0, kFrames, 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    Image noisy(kRows, kCols);
    for (std::ptrdiff_t f = begin; f < end; ++f) {
      Counts& counts = frames[static_cast<std::size_t>(f)];
      counts.bins.assign(truth.edges.size() - 1, 0.0);
      counts.below.assign(kTails.size(), 0.0);
      counts.above.assign(kTails.size(), 0.0);
      compiled.apply(clean, noisy, {.seed = seed, .frame = static_cast<std::uint32_t>(f)});
      count(noisy, truth, counts);
    }
  });
  Counts total = frames[0];
  for (std::size_t f = 1; f < frames.size(); ++f) {
    const auto add = [](auto& to, const auto& from) {
      for (std::size_t i = 0; i < to.size(); ++i) to[i] += from[i];
    };
    add(total.power, frames[f].power);
    add(total.bins, frames[f].bins);
    add(total.below, frames[f].below);
    add(total.above, frames[f].above);
  }
  return total;
}

// Square root of the Jensen-Shannon divergence, base 2.
double root_jsd(const std::vector<double>& p, const std::vector<double>& q) {
  double sum = 0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const double m = 0.5 * (p[i] + q[i]);
    if (p[i] > 0) sum += 0.5 * p[i] * std::log2(p[i] / m);
    if (q[i] > 0) sum += 0.5 * q[i] * std::log2(q[i] / m);
  }
  return std::sqrt(std::max(sum, 0.0));
}

class CompiledExactness : public ::testing::TestWithParam<Case> {};

TEST_P(CompiledExactness, MatchesTheNumericDistributionAtTenToTheEight) {
  const Case& c = GetParam();
  const PixelDistribution distribution(c.channel, {}, 1.0,
                                       static_cast<double>(static_cast<float>(c.signal_dn)));
  const Truth truth = truth_of(distribution);
  const Counts counts = draw(c, truth, 2024);

  // Histogram. Sampling floor: E[JSD] = (cells - 1) / (8 n ln 2) for a true model.
  std::vector<double> p, q;
  double cells = 0;
  for (std::size_t i = 0; i + 1 < truth.edges.size(); ++i) {
    p.push_back(truth.edges[i] < truth.mean
                    ? distribution.cdf(truth.edges[i + 1]) - distribution.cdf(truth.edges[i])
                    : distribution.upper_tail(truth.edges[i]) -
                          distribution.upper_tail(truth.edges[i + 1]));
    q.push_back(counts.bins[i] / kSamples);
    cells += p.back() * kSamples > 1;
  }
  const double floor = std::sqrt((cells - 1) / (8 * kSamples * std::log(2.0)));
  const double found = root_jsd(p, q);
  RecordProperty("root_jsd", std::to_string(found));
  RecordProperty("sampling_floor", std::to_string(floor));
  EXPECT_LT(found, 2 * floor);

  // Tails: binomial counts, five standard deviations.
  for (std::size_t i = 0; i < kTails.size(); ++i) {
    const double expected = kTails[i] * kSamples, sd = std::sqrt(expected);
    EXPECT_NEAR(counts.below[i], expected, 5 * sd) << "lower " << kTails[i];
    EXPECT_NEAR(counts.above[i], expected, 5 * sd) << "upper " << kTails[i];
  }

  // Moments against the numeric expectation, five standard errors from the sample's own 2k-th.
  for (std::size_t k = 1; k <= 4; ++k) {
    const double expected = expectation_of(
        [&](double x) { return std::pow((x - truth.mean) / truth.sd, static_cast<double>(k)); },
        distribution);
    const double mean = counts.power[k] / kSamples;
    const double se = std::sqrt((counts.power[2 * k] / kSamples - mean * mean) / kSamples);
    EXPECT_NEAR(mean, expected, 5 * se) << "moment " << k;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Intensities, CompiledExactness,
    ::testing::Values(
        Case{"Dark", {.gain_dn_per_e = 0.8, .lambda = 0.1, .mu_dn = -2, .sigma_tl_dn = 0.9}, 0},
        Case{"HeavyTails",
             {.gain_dn_per_e = 0.8, .lambda = -0.12, .mu_dn = 0, .sigma_tl_dn = 1.1},
             3},
        Case{"LightTails",
             {.gain_dn_per_e = 0.3, .lambda = 0.3, .mu_dn = 0, .sigma_tl_dn = 0.7},
             1.4},
        Case{"FewElectrons",
             {.gain_dn_per_e = 2.5, .lambda = 0.0, .mu_dn = 0, .sigma_tl_dn = 0.3},
             12.4},
        Case{"AboveTheSwitch",
             {.gain_dn_per_e = 2.5, .lambda = 0.1, .mu_dn = 0, .sigma_tl_dn = 0.3},
             12.6},
        Case{"TenElectrons",
             {.gain_dn_per_e = 5, .lambda = 0.1, .mu_dn = 0, .sigma_tl_dn = 0.4},
             52},
        Case{"HalfWell",
             {.gain_dn_per_e = 0.4, .lambda = 0.1, .mu_dn = 1, .sigma_tl_dn = 0.9},
             2000},
        Case{"Saturation",
             {.gain_dn_per_e = 0.4, .lambda = 0.1, .mu_dn = 1, .sigma_tl_dn = 0.9},
             4095}),
    [](const auto& test) { return std::string(test.param.name); });

// Pure read noise over the whole range of shapes: tail quantiles to 1e-6.
class ReadTails : public ::testing::TestWithParam<double> {};

TEST_P(ReadTails, FollowTukeyLambdaToOneInAMillion) {
  const Case c{"", {.gain_dn_per_e = 1, .lambda = GetParam(), .mu_dn = 0, .sigma_tl_dn = 2}, 0};
  const PixelDistribution distribution(c.channel, {}, 1.0, 0.0);
  Truth truth = truth_of(distribution);
  const Counts counts = draw(c, truth, 7);
  for (std::size_t i = 0; i < kTails.size(); ++i) {
    const double expected = kTails[i] * kSamples, sd = std::sqrt(expected);
    EXPECT_NEAR(counts.below[i], expected, 5 * sd) << "lower " << kTails[i];
    EXPECT_NEAR(counts.above[i], expected, 5 * sd) << "upper " << kTails[i];
  }
}

INSTANTIATE_TEST_SUITE_P(Shapes, ReadTails, ::testing::Values(-0.3, -0.15, 0.0, 0.14, 0.3));

}  // namespace
}  // namespace malus
