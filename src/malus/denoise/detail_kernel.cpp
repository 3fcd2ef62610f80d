// The inner loop of the detail shrinkage, as stack_kernel.cpp: the same bits on all machines.
#include "malus/denoise/internal/detail_kernel.h"

#include "malus/base/vector_targets.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/denoise/detail_kernel.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.
#include <hwy/highway.h>

#pragma GCC diagnostic ignored "-Wpsabi"

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {

#include "malus/denoise/internal/cells-inl.h"

HWY_INLINE float* cell_at(DetailBlock& block, int i) {
  return block.pixels + (i / kDetailSide * kDetailBlock + i % kDetailSide) * kCell;
}

/// How many times the passed noise a band holds, in the group of components that holds most.
HWY_INLINE float most_of(const Floats& squares, const float (&per_noise)[kLanes]) {
  float lanes[kLanes], most = 0;
  store(squares, lanes);
  int begin = 0;
  for (const int end : kDetailGroups) {
    float sum = 0;
    for (; begin < end; ++begin) sum += lanes[begin] * per_noise[begin];
    most = std::max(most, sum);
  }
  return most;
}

float shrink(const DetailJob& job, float half_at, DetailBlock& block) {
  constexpr float kLeast = 1e-12f;  // of half_at
  constexpr float kAll = 1e9f;      // of the cube: the gain is 1
  Floats cells[kDetailCells], squares[kDetailBands] = {};
  for (int i = 0; i < kDetailCells; ++i) cells[i] = load_cell(cell_at(block, i), kDetailBlock);
  rotate(cells, kDetailCells, *job.axes);
  transform_block<kDetailSide>(cells, job.dct, false);
  for (int i = 1; i < kDetailCells; ++i) squares[job.band_of[i]] += cells[i] * cells[i];
  float gains[kDetailBands], kept = 0;
  for (int band = 0; band < kDetailBands; ++band) {
    const float times = most_of(squares[band], job.per_noise[band]) / std::max(half_at, kLeast);
    // Steep, for detail above the noise is what the filter has kept with good reason.
    const float cube = std::min(times * times * times, kAll);
    gains[band] = cube / (cube + 1.0f);
    kept += job.share[band] * gains[band] * gains[band];
  }
  for (int i = 1; i < kDetailCells; ++i) cells[i] *= gains[job.band_of[i]];
  transform_block<kDetailSide>(cells, job.dct, true);
  rotate(cells, kDetailCells, *job.axes_back);
  std::fill(std::begin(block.pixels), std::end(block.pixels), 0.0f);
  for (int i = 0; i < kDetailCells; ++i)
    add_cell(cell_at(block, i), kDetailBlock, cells[i] * job.window[i]);
  return kept;
}

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace malus::internal {
HWY_EXPORT(shrink);
float shrink_detail_block(const DetailJob& job, float half_at, DetailBlock& block) {
  return HWY_DYNAMIC_DISPATCH(shrink)(job, half_at, block);
}
}  // namespace malus::internal
#endif
