// Non-parametric noise (001, Eq. 3 and S2): per signal level a histogram of noisy - clean, drawn
// exactly by Walker's alias method ("An efficient method for generating discrete random variables
// with general distributions", ACM TOMS 3, 1977) and uniform inside the bin. Between two levels one
// of them is chosen at random with the fractional distance as probability, so that mean and second
// moment interpolate linearly in the signal, as shot noise does; below the first level and above
// the last, these serve.
#pragma once

#include "malus/image/view.h"
#include "malus/noise/calibration.h"
#include "malus/synthesize/exact.h"
#include "malus/synthesize/formation.h"

#include <cstdint>
#include <vector>

namespace malus {

/// One cell of an alias table and the bin's place, DN.
struct AliasCell {
  std::uint32_t threshold;  ///< of the 24 low bits: below it the cell's own bin, else the alias
  std::uint32_t alias;
};
struct BinPlace {
  float start_dn, width_dn;
};

/// One channel: plain data for CPU and GPU. Levels ascend.
struct LevelTables {
  int levels = 0, bins = 0;
  const float* level_dn = nullptr;       ///< levels entries
  const AliasCell* alias = nullptr;      ///< levels x bins
  const BinPlace* places = nullptr;      ///< bins entries, or levels x bins
  int places_per_level = 0;              ///< 0 = all levels share theirs; else bins
  const std::uint16_t* guess = nullptr;  ///< kGuesses + 1: level at or below each of equal steps
  float guess_start_dn = 0, guesses_per_dn = 0;
};

inline constexpr int kGuesses = 1024;

/// noisy - clean of one pixel. Shot word: which bin (its 24 low bits against the threshold); read
/// word: place inside the bin (upper half) and level (lower half).
MALUS_HOST_DEVICE inline float level_noise(const LevelTables& t, float signal_dn,
                                           PixelWords words) {
  int level = 0;
  if (t.levels > 1) {
    const float step = (signal_dn - t.guess_start_dn) * t.guesses_per_dn;
    level = t.guess[step <= 0.0f                           ? 0
                    : step >= static_cast<float>(kGuesses) ? kGuesses
                                                           : static_cast<int>(step)];
    while (level + 2 < t.levels && signal_dn >= t.level_dn[level + 1]) ++level;
    const float low = t.level_dn[level], high = t.level_dn[level + 1];
    const float distance = (signal_dn - low) / (high - low) * 65536.0f;
    if (static_cast<float>(words.read & 0xFFFFu) < distance) ++level;
  }
  // The bin comes from the product with the number of bins, its high half; what is left of the
  // word, 24 bits of it, meets the threshold.
  const std::uint64_t product = std::uint64_t{words.shot} * static_cast<std::uint32_t>(t.bins);
  auto bin = static_cast<std::uint32_t>(product >> 32);
  const AliasCell cell = t.alias[static_cast<std::uint32_t>(level * t.bins) + bin];
  if ((static_cast<std::uint32_t>(product) >> 8) >= cell.threshold) bin = cell.alias;
  const float inside = (static_cast<float>(words.read >> 16) + 0.5f) * 0x1p-16f;
  const BinPlace place = t.places[static_cast<std::uint32_t>(level * t.places_per_level) + bin];
  return place.start_dn + place.width_dn * inside;
}

/// Noise at one signal level on bins of its own.
struct LevelDistribution {
  double level_dn = 0;
  std::vector<double> bin_edges_dn;  ///< rising, of noisy - clean
  std::vector<double> pmf;
};

class LevelSampler {
 public:
  /// Contract: one channel of the calibration per channel of the layout, as models are checked.
  /// row_group 0: no row noise.
  LevelSampler(const SensorLayout& layout, const NonparametricCalibration& calibration,
               int row_group);
  /// Per channel its levels, rising, all with equally many bins; sigma_row_dn: one per channel or
  /// empty.
  LevelSampler(const SensorLayout& layout,
               const std::vector<std::vector<LevelDistribution>>& channels,
               const std::vector<double>& sigma_row_dn, int row_group);

  // The channels' tables point into the object.
  LevelSampler(LevelSampler&&) = default;
  LevelSampler& operator=(LevelSampler&&) = default;

  /// DN above black in and out, in place if wanted; as CompiledNoise::apply.
  void apply(View<const float> clean_dn, View<float> noisy_dn, const DrawAddress& address) const {
    apply(clean_dn, clean_dn, noisy_dn, address);
  }
  /// out = base + noise at the level of `signal`.
  void apply(View<const float> signal_dn, View<const float> base_dn, View<float> out_dn,
             const DrawAddress& address) const;

 private:
  struct Channel {
    std::vector<float> level_dn;
    std::vector<AliasCell> alias;
    std::vector<BinPlace> places;
    std::vector<std::uint16_t> guess;
    LevelTables tables;
    float sigma_row_dn = 0;
  };
  void finish(Channel& channel, int bins, bool shared_places);

  SensorLayout layout_;
  std::vector<Channel> channels_;
  int row_group_ = 0;
};

/// Walker's tables of bin probabilities (non-negative, any sum above 0); thresholds in 2^-24.
std::vector<AliasCell> alias_cells(const std::vector<double>& probabilities);

}  // namespace malus
