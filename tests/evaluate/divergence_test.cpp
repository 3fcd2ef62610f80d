#include "malus/evaluate/divergence.h"

#include "malus/base/random.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

using Counts = std::vector<std::int64_t>;

TEST(Divergence, ClosedFormsOfTwoBins) {
  const Counts p = {3000, 1000}, q = {1000, 1000};
  EXPECT_NEAR(*kld_nats(q, p), 0.5 * std::log(0.5 / 0.75) + 0.5 * std::log(0.5 / 0.25), 1e-12);
  EXPECT_NEAR(*kld_nats(p, q), 0.75 * std::log(0.75 / 0.5) + 0.25 * std::log(0.25 / 0.5), 1e-12);
  const auto h = [](double x) { return -x * std::log2(x) - (1 - x) * std::log2(1 - x); };
  EXPECT_NEAR(*jsd_bits(p, q), h(0.625) - 0.5 * (h(0.75) + h(0.5)), 1e-12);
  EXPECT_NEAR(*jsd_bits(q, p), *jsd_bits(p, q), 1e-15);
}

TEST(Divergence, EndsAreZeroAndOne) {
  const Counts a = {10, 20, 0, 0}, b = {0, 0, 7, 1};
  EXPECT_DOUBLE_EQ(*kld_nats(a, a), 0);
  EXPECT_DOUBLE_EQ(*jsd_bits(a, a), 0);
  EXPECT_DOUBLE_EQ(*jsd_bits(a, b), 1);
  EXPECT_TRUE(std::isfinite(*kld_nats(a, b)));
  EXPECT_GT(*kld_nats(a, b), 1);
}

TEST(Divergence, EmptyHistogramsDecideNothing) {
  const Counts a = {1, 2}, none = {0, 0};
  EXPECT_FALSE(kld_nats(a, none).decided());
  EXPECT_FALSE(jsd_bits(none, a).decided());
  EXPECT_FALSE(jsd_floor_bits(none, a).decided());
}

// Gaussians of equal width: D = Δ²/(2σ²) nats.
TEST(Divergence, GaussiansShiftedByOneSigma) {
  Counts p(400), q(400);
  for (int i = 0; i < 400; ++i) {
    const double x = (i - 199.5) / 25;
    p[static_cast<std::size_t>(i)] = std::llround(1e12 * std::exp(-0.5 * x * x));
    q[static_cast<std::size_t>(i)] = std::llround(1e12 * std::exp(-0.5 * (x - 1) * (x - 1)));
  }
  EXPECT_NEAR(*kld_nats(q, p), 0.5, 1e-3);
}

TEST(Divergence, FloorIsTheMeanOverSamplesOfOneDistribution) {
  RandomSequence random(2, 0, Draw::kOther);
  double sum = 0, floor = 0, kld = 0;
  constexpr int kTrials = 300;
  for (int t = 0; t < kTrials; ++t) {
    Counts a(20), b(20);
    for (int i = 0; i < 5000; ++i) ++a[static_cast<std::size_t>(20 * random.uniform())];
    for (int i = 0; i < 2000; ++i) ++b[static_cast<std::size_t>(20 * random.uniform())];
    sum += *jsd_bits(a, b);
    floor += *jsd_floor_bits(a, b);
    kld += *kld_nats(a, b);
  }
  // The divergence follows chi-square with 19 degrees of freedom: 32 % spread, 2 % on the mean of
  // 300; four standard errors.
  EXPECT_NEAR(sum / floor, 1, 0.08);
  EXPECT_NEAR(kld / kld_floor_nats(floor), 1, 0.08);
}

}  // namespace
}  // namespace malus
