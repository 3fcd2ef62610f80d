// What the second pass over the bias frames of a gain keeps of each.
#pragma once

#include "malus/calibrate/internal/across_frames.h"
#include "malus/calibrate/internal/frame_components.h"
#include "malus/calibrate/internal/residual_histogram.h"

#include <vector>

namespace malus {

/// All bias frames of one gain, one entry per frame: a few kilobytes each, whatever the frame's
/// size.
struct BiasFrames {
  FrameSeries mean, pixel, row, column, total, row_offset;
  std::vector<std::vector<ResidualHistogram>> residuals, above;  ///< [frame][channel]

  void add(FrameComponents&& frame);
};

/// Per channel. Contract: at least one frame.
std::vector<double> mean_over_frames(const FrameSeries& series);

}  // namespace malus
