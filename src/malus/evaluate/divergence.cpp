#include "malus/evaluate/divergence.h"

#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

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

double jsd_bits_of(std::span<const double> p, std::span<const double> q) {
  MALUS_REQUIRE(p.size() == q.size());
  double sum = 0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const double mean = 0.5 * (p[i] + q[i]);
    if (p[i] > 0) sum += 0.5 * p[i] * std::log2(p[i] / mean);
    if (q[i] > 0) sum += 0.5 * q[i] * std::log2(q[i] / mean);
  }
  return sum > 0 ? sum : 0.0;
}

Estimate<double> jsd_bits(std::span<const std::int64_t> a, std::span<const std::int64_t> b) {
  MALUS_REQUIRE(a.size() == b.size());
  const double n_a = total(a), n_b = total(b);
  if (n_a == 0 || n_b == 0) return kEmpty;
  std::vector<double> p, q;
  for (std::size_t i = 0; i < a.size(); ++i) {
    p.push_back(static_cast<double>(a[i]) / n_a);
    q.push_back(static_cast<double>(b[i]) / n_b);
  }
  return jsd_bits_of(p, q);
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
