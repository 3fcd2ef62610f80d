// What bias frames say against themselves, as warnings with numbers.
#pragma once

#include "malus/calibrate/frame_set.h"
#include "malus/calibrate/geometry.h"
#include "malus/calibrate/internal/across_frames.h"
#include "malus/calibrate/internal/residual_histogram.h"
#include "malus/calibrate/internal/rounded_noise.h"
#include "malus/image/layout.h"
#include "malus/noise/calibration.h"

#include <vector>

namespace malus {

/// Level that rises or falls over the frames by more than five standard errors and a twentieth of
/// the temporal noise.
void warn_of_drift(const FrameSeries& frame_means_dn, double temporal_sd_dn,
                   PhysicsCalibration& out);

/// Frames whose level lies more than eight robust deviations and a fifth of the temporal noise from
/// the median of all.
void warn_of_outlying_frames(const FrameSeries& frame_means_dn, double temporal_sd_dn,
                             PhysicsCalibration& out);

/// Frames whose mean absolute residual differs from the middle frame's by more than 15 % and by
/// more than eight of its standard errors, as those of another gain do; of three frames or more.
/// residuals: [frame][channel]. hidden: per channel, or empty; where the step hides the noise, what
/// shows of it follows the frame's level, and nothing is said. columns: of the frame, whose offsets
/// are in the residuals. Reads sigma_row, sigma_column and temporal_sd_dark_dn.
void warn_of_outlying_noise(const std::vector<std::vector<ResidualHistogram>>& residuals,
                            const std::vector<HiddenNoise>& hidden, int columns,
                            PhysicsCalibration& out);

/// A dark level more than a tenth of the range above black; or, where black is declared, more than
/// twenty deviations of the dark noise; or a tenth of black (1 DN at least) below it. Reads mu and
/// temporal_sd_dark_dn.
void warn_of_high_level(const FrameFormat& format, PhysicsCalibration& out);

/// Dark level whose means over the sixteenths of the frame differ by more than half of the temporal
/// noise, and by more than chance, rows and the fixed pattern of pixels, rows and columns explain:
/// light, amplifier glow or outputs that differ. Reads sigma_row, row_drift and bias_frames.
void warn_of_light(View<const float> shading_dn, const MosaicGeometry& geometry,
                   double temporal_sd_dn, PhysicsCalibration& out);

/// A dark level more than four deviations of the dark noise above a declared black, of which the
/// shot noise of as much light would make from 0.6 to 1.15 of the variance. Reads mu, K and
/// temporal_sd_dark_dn.
void warn_of_lit_darkness(const FrameFormat& format, PhysicsCalibration& out);

/// Channels with more than a thousandth of the dark pixels at the floor, where the camera
/// cuts the noise off: lowest_dn, as the files have it. Fills dark_zero_share then.
void warn_of_clipping(const std::vector<double>& zero_share, const std::vector<double>& lowest_dn,
                      const SensorLayout& layout, PhysicsCalibration& out);

/// Columns whose offsets change from frame to frame by more than a tenth of the temporal noise and
/// by more than five standard errors: synthesis draws that as noise of single pixels. Reads
/// sigma_column and temporal_sd_dark_dn.
void warn_of_column_noise(PhysicsCalibration& out);

}  // namespace malus
