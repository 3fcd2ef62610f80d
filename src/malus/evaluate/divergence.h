// Distances between two samples of noise, from their histograms over the same bins (001, S3;
// docs/polarization.md, "Metrics").
#pragma once

#include "malus/base/estimate.h"

#include <cstdint>
#include <numbers>
#include <span>

namespace malus {

/// Kullback-Leibler divergence D(Q||P) = sum Q ln(Q/P) in nats (001 Eq. 1). A bin that holds test
/// samples but no reference sample counts as half a reference sample: the divergence stays finite
/// and says so by its size. Undecided when either histogram is empty. Sizes equal.
Estimate<double> kld_nats(std::span<const std::int64_t> test_q,
                          std::span<const std::int64_t> reference_p);

/// Jensen-Shannon divergence with base-2 logarithms, 0 (equal) to 1 (disjoint); symmetric (001
/// Eq. 2). Undecided when either histogram is empty.
Estimate<double> jsd_bits(std::span<const std::int64_t> a, std::span<const std::int64_t> b);

/// The same of two distributions whose probabilities are known, each adding to 1.
double jsd_bits_of(std::span<const double> p, std::span<const double> q);

/// What jsd_bits gives on average for two samples of one distribution, from their sizes alone:
/// (occupied bins - 1)/(8 ln 2) (1/n_a + 1/n_b), the second-order expansion of the divergence. A
/// value near it shows no difference.
Estimate<double> jsd_floor_bits(std::span<const std::int64_t> a, std::span<const std::int64_t> b);

/// What kld_nats gives on average for such samples, (occupied bins - 1)/2 (1/n_a + 1/n_b), from
/// their jsd_floor_bits: to second order a KLD is four times the JSD in nats. Bins of few samples
/// add to it.
constexpr double kld_floor_nats(double floor_of_jsd_bits) {
  return 4 * std::numbers::ln2 * floor_of_jsd_bits;
}

}  // namespace malus
