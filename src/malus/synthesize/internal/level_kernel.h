// The vector kernel behind LevelSampler: rows of a mosaic, any instruction set, chosen at run time.
#pragma once

#include "malus/synthesize/exact.h"
#include "malus/synthesize/formation.h"
#include "malus/synthesize/level_tables.h"

#include <cstdint>

namespace malus::internal {

/// Per-channel numbers repeated along a row with a period that is a multiple of kGroupColumns.
struct LevelRowLanes {
  int period = 0;
  const float *guess_start_dn = nullptr, *guesses_per_dn = nullptr;
  const float* offset_dn = nullptr;  ///< sigma_row z of this row
  const std::uint32_t *first_guess = nullptr, *first_span = nullptr, *last_span = nullptr;
  const std::uint32_t *bins = nullptr, *first_cell = nullptr, *first_place = nullptr;
  const std::uint32_t* places_per_level = nullptr;
};

struct LevelRowJob {
  LevelTables tables;
  LevelRowLanes lanes;
  std::uint64_t seed = 0;
  std::uint32_t frame = 0;
  int row = 0, col0 = 0, cols = 0;  ///< mosaic row and first column; number of columns
  const float *signal_dn = nullptr, *base_dn = nullptr;
  float* out_dn = nullptr;
};

/// out = base + noise at the level of signal + offset; where one is not finite, base alone.
void run_level_row(const LevelRowJob& job);

}  // namespace malus::internal
