// Noisy raw frames with their clean signal, as a camera would have written them: drawn from clean
// scenes with a random sensor's noise, or read from what `malus dataset` and `malus pairs` wrote.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/neural/internal/clean_scenes.h"
#include "malus/neural/training_config.h"
#include "malus/noise/profile.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus {

struct RawPair {
  RawFrame noisy;
  /// DN above black and bias, at the noisy frame's light; NaN where a captured reference does not
  /// tell it: no loss counts such pixels.
  Image clean_dn;
  /// The same light as R, G, B of the mosaic's size, where a network's target asks for it and the
  /// source knows more than the mosaic; else empty. NaN as above.
  Planes clean_rgb_dn;
  NoiseProfile profile;
  double ratio = 1;  ///< low-light ratio: clean_dn * ratio is the reference
};

/// Pair `number` is a function of the source's settings, the seed and number. Any thread.
class PairSource {
 public:
  virtual ~PairSource() = default;
  virtual RawPair pair(std::uint64_t seed, std::uint32_t number) const = 0;
  /// Pictures and scenes, samples of shards, or captured pairs that it draws from.
  virtual std::size_t size() const = 0;
  /// Of several kinds: their sizes and shares of the examples, by their names; else null.
  virtual nlohmann::ordered_json shares() const { return {}; }
  /// What speaks against the noise of the pairs: models that do not say their gain.
  virtual std::vector<std::string> complaints() const { return {}; }
};

/// Of all that the configuration names; where it names several kinds, each pair is drawn from one
/// of them, by their sizes. Throws InputError.
std::unique_ptr<PairSource> make_pair_source(const TrainingConfig& config);

}  // namespace malus
