// The non-parametric model of one gain: distributions of noisy - clean at many signal levels, row
// noise kept apart (001, S1-S2).
#pragma once

#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/frame_set.h"

#include <optional>
#include <vector>

namespace malus {

/// Frames of one static scene that noise is taken from, and the cleaner ones it is compared with.
struct NoiseSource {
  const FrameSet* frames = nullptr;  ///< bias, flat or burst
  const FrameSet* reference =
      nullptr;  ///< low-gain stack of the same scene; null: the frames' mean
};

/// Clean is the mean of the reference mapped to the frames by a fitted line, or the mean of the
/// frames themselves (the fixed pattern then is not noise; each frame's share in that mean is
/// accounted for). Row-group means of noisy - clean are taken off first: row noise is in
/// sigma_row. The channel's dark bias stays in, as the distributions' mean. Integer bias frames
/// make the dark level code by code, fixed pattern included, with row noise deconvolved: unequal
/// steps of the converter stay visible. physics: the same
/// gain's bias results, for the dark level, row noise and K; null: the black level is dark and row
/// noise comes from the darkest source. Two passes over each source. Throws InputError when fewer
/// than two levels of a channel have enough samples.
NonparametricCalibration measure_levels(const std::vector<NoiseSource>& sources,
                                        const RawFrame& first, const PhysicsCalibration* physics,
                                        int row_group, const CalibrationSettings& settings,
                                        Progress& progress);

}  // namespace malus
