// How bright, against its noise, the light was that a network was trained on, and what is made of
// its corrections where a frame is brighter: there they are invented, up to 10 dB worse than the
// guide (docs/networks.md, "Light brighter than in the training").
#pragma once

#include "malus/base/progress.h"
#include "malus/neural/internal/raw_pairs.h"
#include "malus/neural/package.h"

#include <cstdint>

#include <torch/torch.h>

namespace malus {

/// [batch, 1, rows, cols]: the guide's signal, or the noisy one where there is no guide, in
/// deviations of the noise; mean over the planes. Contract: the package has noise planes.
torch::Tensor signal_in_deviations(const NetworkPackage& package, const torch::Tensor& input);

/// The light that training shows: the 99.9th percentile of signal_in_deviations over the first
/// examples. Infinite for a package without noise planes. Throws InputError as make_example,
/// Cancelled.
double brightest_light(const NetworkPackage& package, const PairSource& source, std::uint64_t seed,
                       Progress& progress);

/// [batch, 1, rows, cols]: the share of a correction that is taken: all in light a fifth below
/// package.brightest, none a fifth above it.
torch::Tensor share_of_correction(const NetworkPackage& package, const torch::Tensor& input);

/// How many places of an input are brighter than package.brightest.
std::int64_t count_brighter(const NetworkPackage& package, const torch::Tensor& input);

}  // namespace malus
