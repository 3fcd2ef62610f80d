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

/// Name of the instruction set in use, and the choice of another for tests ("" = the best).
std::string kernel_target();
std::vector<std::string> kernel_targets();
void force_kernel_target(const std::string& name);

}  // namespace malus::internal
