#include "malus/evaluate/divergence.h"

#include <cmath>
#include <numbers>
#include <numeric>

namespace malus {
namespace {

double total(std::span<const std::int64_t> counts) {
  return static_cast<double>(std::accumulate(counts.begin(), counts.end(), std::int64_t{0}));
}

const Undecided kEmpty{"a histogram holds no sample"};

}  // namespace

Estimate<double> kld_nats(std::span<const std::int64_t> test_q,
                          std::span<const std::int64_t> reference_p) {
  MALUS_REQUIRE(test_q.size() == reference_p.size());
  const double n_q = total(test_q), n_p = total(reference_p);
  if (n_q == 0 || n_p == 0) return kEmpty;
  const auto held = [&](std::size_t i) {
    return reference_p[i] == 0 && test_q[i] > 0 ? 0.5 : static_cast<double>(reference_p[i]);
  };
  double n_held = 0, sum = 0;
  for (std::size_t i = 0; i < test_q.size(); ++i) n_held += held(i);
  for (std::size_t i = 0; i < test_q.size(); ++i) {
    if (test_q[i] == 0) continue;
    const double q = static_cast<double>(test_q[i]) / n_q;
    sum += q * std::log(q * n_held / held(i));
  }
  return sum;
}

Estimate<double> jsd_bits(std::span<const std::int64_t> a, std::span<const std::int64_t> b) {
  MALUS_REQUIRE(a.size() == b.size());
  const double n_a = total(a), n_b = total(b);
  if (n_a == 0 || n_b == 0) return kEmpty;
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double p = static_cast<double>(a[i]) / n_a, q = static_cast<double>(b[i]) / n_b;
    const double mean = 0.5 * (p + q);
    if (p > 0) sum += 0.5 * p * std::log2(p / mean);
    if (q > 0) sum += 0.5 * q * std::log2(q / mean);
  }
  return sum > 0 ? sum : 0.0;
}

Estimate<double> jsd_floor_bits(std::span<const std::int64_t> a, std::span<const std::int64_t> b) {
  MALUS_REQUIRE(a.size() == b.size());
  const double n_a = total(a), n_b = total(b);
  if (n_a == 0 || n_b == 0) return kEmpty;
  int occupied = 0;
  for (std::size_t i = 0; i < a.size(); ++i) occupied += a[i] + b[i] > 0;
  return (occupied - 1) / (8 * std::numbers::ln2) * (1 / n_a + 1 / n_b);
}

}  // namespace malus
