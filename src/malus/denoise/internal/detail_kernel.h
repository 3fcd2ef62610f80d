// What the vectorised loop of the detail shrinkage works on.
#pragma once

#include "malus/denoise/internal/detail_shrinkage.h"

namespace malus::internal {

inline constexpr int kDetailCells = kDetailSide * kDetailSide;
inline constexpr int kDetailBands = 9;  ///< of frequency, without the blocks' means
/// Components, the strongest first, are judged in groups that end before these.
inline constexpr int kDetailGroups[] = {1, 4, 8, kLanes};

struct DetailJob {
  const CellMatrix* axes;
  const CellMatrix* axes_back;  ///< transposed
  float dct[kDetailSide][kDetailSide];
  float window[kDetailCells];  ///< of cells; those of overlapping blocks add up to 1
  int band_of[kDetailCells];   ///< of a coefficient; -1: the mean, which is left alone
  float share[kDetailBands];   ///< of the coefficients that are in the band
  /// Multiplied by a band's squares and added up over a group they give 1 where all is passed
  /// noise, with 1 let through of the samples' variance of 1.
  float per_noise[kDetailBands][kLanes];
};

struct DetailBlock {
  float pixels[kDetailBlock * kDetailBlock];
};

/// Shrinks a block and multiplies it by the window. half_at: energies of so much passed noise [the
/// samples' variance] keep half; 0 keeps all. Returns the mean of its squared gains.
float shrink_detail_block(const DetailJob& job, float half_at, DetailBlock& block);

}  // namespace malus::internal
