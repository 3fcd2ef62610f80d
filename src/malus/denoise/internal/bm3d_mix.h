// Of sensors with one channel no colours and angles tell blocks apart, and plain BM3D of the same
// samples (bm3d.h) is as good on photographs and better on what is small and stands alone, as
// stars, while it keeps more noise of smooth light. So the estimate and BM3D's are mixed, place by
// place: Stein's unbiased estimate of the squared error (Ann. Statist. 9, 1981) tells what a mix
// leaves. What it needs of either is how much of a sample's own noise goes into its estimate; of
// estimates that are as good as their samples allow that is their expected squared error (Tweedie's
// formula: Efron, J. Am. Stat. Assoc. 106, 2011), which both of them state.
#pragma once

#include "malus/denoise/internal/frame_filter.h"
#include "malus/denoise/internal/memory_budget.h"
#include "malus/image/layout.h"

#include <string>

namespace malus::internal {

/// How a frame is cut for it: parts [pixels], on BM3D's lattice.
struct Bm3dMix {
  std::string profile;  ///< BM3D's
  int part_rows, part_cols;
};

/// Whether the result is mixed: not in profile `fast`, whose own last pass is a Wiener filter too.
bool mixes_bm3d(const std::string& method, const std::string& profile, const SensorLayout& layout);

/// profile: of the method. A part with its surroundings takes no more than the memory. Throws
/// InputError when that is too little.
Bm3dMix plan_bm3d_mix(const std::string& profile, int rows, int cols, const MemoryBudget& memory);

/// Stabilised samples from `pixel` change `estimate`, which was made of them, and cell_error, its
/// expected squared error (FrameReport::cell_error). Users are told the error before the mix, which
/// mixes do not exceed. Parts and threads do not change a byte of the result. Throws Cancelled.
void mix_bm3d(const Bm3dMix& mix, const PixelSource& pixel, Image& cell_error, Image& estimate,
              Progress& progress);

}  // namespace malus::internal
