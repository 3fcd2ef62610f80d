// The vector kernel behind CompiledNoise: rows of a mosaic, any instruction set, chosen at run
// time.
#pragma once

#include "malus/synthesize/exact.h"
#include "malus/synthesize/formation.h"

#include <cstdint>
#include <string>
#include <vector>

namespace malus::internal {

/// Per-channel parameters repeated along a row with a period that is a multiple of kGroupColumns.
struct RowLanes {
  int period = 0;
  const float* gain_dn = nullptr;           ///< K; for kGaussian the slope S
  const float* electrons_per_dn = nullptr;  ///< 1/K
  const float* variance_dn2 = nullptr;      ///< kGaussian: O
  const float* scale_dn = nullptr;          ///< read noise per table unit
  const float* offset_dn = nullptr;         ///< mu + sigma_b z of this row
  const float* black_dn = nullptr;
  const std::uint32_t* first_line = nullptr;  ///< of the channel's table, minus kTailFirst
};

struct RowJob {
  FormationTables tables;
  RowLanes lanes;
  std::uint64_t seed = 0;
  std::uint32_t frame = 0;
  int row = 0, col0 = 0, cols = 0;  ///< mosaic row and first column; number of columns
  const void* in = nullptr;         ///< first pixel: float DN above black, or uint16 raw
  void* out = nullptr;              ///< float DN above black, or uint16 raw
  bool in_u16 = false, out_u16 = false;
  float step_dn = 1, white_dn = 65535;  ///< for uint16 out: rounding step, clip
};

void run_row(const RowJob& job);

/// The words of one group of kGroupColumns columns (pixel_words of each), by the vector unit.
void group_words(std::uint64_t seed, std::uint32_t frame, int row, int group, std::uint32_t* shot,
                 std::uint32_t* read);

/// Calls visit(c, words) for the columns col0 + c, c < cols, of a row.
template <class Visit>
void for_each_word_pair(const DrawAddress& address, int row, int cols, Visit&& visit) {
  std::uint32_t shot[kGroupColumns], read[kGroupColumns];
  int held = -1;
  for (int c = 0; c < cols; ++c) {
    const int col = address.col0 + c, group = col / kGroupColumns, place = col % kGroupColumns;
    if (group != held) group_words(address.seed, address.frame, row, held = group, shot, read);
    visit(c, PixelWords{shot[place], read[place]});
  }
}

/// Name of the instruction set in use, and the choice of another for tests ("" = the best).
std::string kernel_target();
std::vector<std::string> kernel_targets();
void force_kernel_target(const std::string& name);

}  // namespace malus::internal
