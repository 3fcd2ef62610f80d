// Pairs that lie in files: the shards of `malus dataset`, the pairs of `malus pairs`.
#pragma once

#include "malus/neural/internal/raw_pairs.h"

#include <memory>

namespace malus {

/// Shards (WebDataset tars) with dataset.json beside them; their noise is described by the one
/// noise model of the configuration. An example is a piece of a sample at whole cells and row
/// groups. Throws InputError.
std::unique_ptr<PairSource> open_shards(const TrainingConfig& config);

/// pairs.json lists with their frames beside them; noise and pieces as above. An entry may name a
/// "picture" beside "reference": the reference's light as R, G, B planes of its size, for networks
/// that give pictures. Throws InputError.
std::unique_ptr<PairSource> open_captured_pairs(const TrainingConfig& config);

}  // namespace malus
