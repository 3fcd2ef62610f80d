// What the vectorised loop of the joint bilateral filter works on: plain pointers into a band of
// rows whose surroundings are there.
#pragma once

#include "malus/denoise/internal/stack_stage.h"

#include <cstddef>
#include <cstdint>

namespace malus::internal {

/// The guide of what is no pixel: nothing is like it.
inline constexpr float kNoGuide = 1e6f;

/// One row of pixels, in blocks of kLanes; the last may reach beyond the row's end. Around every
/// pixel of a block there are `reach` steps of the layout in each direction.
struct BilateralRow {
  const float* samples;
  const float* guide;
  std::ptrdiff_t stride;          ///< of both
  int step_rows, step_cols;       ///< of the layout: pixels of one channel
  int reach;                      ///< in steps
  int blocks;                     ///< of kLanes pixels
  const std::uint8_t* is_wanted;  ///< per block
  const float* per_cut;           ///< per pixel: one over the difference from which nothing counts
  float* mean;                    ///< per pixel: weighted mean of the samples around it
  float* own;                     ///< the weight of the pixel's own sample in that
  float* slope;                   ///< its derivative by the pixel's own guide
};

/// Weights are (1 - u²)⁴, u the difference of the guides times per_cut, 0 beyond 1. Of blocks that
/// are not wanted nothing is written.
void average_alike(const BilateralRow& row);

}  // namespace malus::internal
