// Bias frames whose noise the converter's step hides, or the camera cuts off at 0: level, rows,
// read noise and fixed pattern as they were before.
#pragma once

#include "malus/calibrate/internal/bias_calibration.h"
#include "malus/calibrate/internal/bias_frames.h"
#include "malus/calibrate/internal/fixed_pattern.h"
#include "malus/calibrate/internal/frame_components.h"
#include "malus/calibrate/internal/rounded_noise.h"
#include "malus/noise/calibration.h"

#include <vector>

namespace malus {

/// Fills hidden of `dark`; where the step hides a channel's noise, mu, sigma_row and sigma_column
/// of `out` are what its pairs of codes tell, else they get the error that rounding may make.
/// mean_frame: its ordinary pixels.
void take_hidden_noise(const GainRun& run, CodePairCounter& pairs, const OrdinaryPixels& mean_frame,
                       DarkPass& dark, PhysicsCalibration& out);

/// Level, variances and residuals as they were before the camera cut the noise off at 0, in
/// `frames` and `out`; fills cut_off of `dark`, of which hidden is filled. Offsets show by the
/// share of the pixels that are not cut off (Stein's lemma). dsnu_dn: per channel, as the frames
/// show it.
void undo_cut_off(const std::vector<double>& dsnu_dn, const FrameAnalyzer& analyzer,
                  const std::vector<double>& black_dn, DarkPass& dark, BiasFrames& frames,
                  PhysicsCalibration& out);

/// dsnu of `out`, which measure_dsnu made of values that are rounded and perhaps cut off: as
/// `dark` knows it, or with the error that rounding may make where it does not. A warning where
/// noise before the cut is known only roughly.
void restore_dsnu(const DarkPass& dark, PhysicsCalibration& out);

}  // namespace malus
