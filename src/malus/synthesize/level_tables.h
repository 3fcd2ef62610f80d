// The tables of non-parametric noise: plain data that all twins of the kernel share. The channels'
// parts lie one behind the other.
#pragma once

#include <cstdint>

namespace malus {

/// One cell of an alias table.
struct AliasCell {
  std::uint32_t threshold;  ///< of 24 bits: below it the cell's own bin, else the alias
  std::uint32_t alias;
};
/// A bin of noisy - signal.
struct BinPlace {
  float start_dn, width_dn;
};
/// Signals from one level to the next; a single level reaches to infinity.
struct LevelSpan {
  float low_dn, high_dn;
};

/// Steps of equal width from a channel's first level to its last.
inline constexpr int kGuesses = 1024;

struct LevelTables {
  const std::uint32_t* guess = nullptr;  ///< kGuesses + 1 a channel: span at or below each step
  const LevelSpan* spans = nullptr;      ///< levels - 1 a channel (1 for a single level)
  const AliasCell* cells = nullptr;      ///< levels x bins a channel
  const BinPlace* places = nullptr;      ///< bins, or levels x bins, a channel
};

}  // namespace malus
