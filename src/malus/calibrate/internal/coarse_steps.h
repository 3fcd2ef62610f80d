// Dark noise that is wide enough to be measured, but so narrow for the converter's step that
// rounding moves what is measured.
#pragma once

#include "malus/calibrate/internal/rounded_noise.h"
#include "malus/noise/calibration.h"

#include <vector>

namespace malus {

/// Noise too narrow for the converter's step, so that rounding hides it: of the noise's
/// characteristic function at one cycle per step more is left than of normal noise of half a step
/// (Widrow, Kollár, Liu, IEEE Trans. Instrum. Meas. 45, 1996). Heavy-tailed noise has a narrow core
/// and may deviate by a whole step. Also where all dark pixels are equal. Reads
/// temporal_sd_dark_dn, sigma_tl, lambda and sigma_row.
void warn_of_coarse_steps(double quantization_dn, PhysicsCalibration& out);

/// What rounding may do to mu, temporal_sd_dark_dn, sigma_row, sigma_column and dsnu_dn, into their
/// standard errors: its deviation over the offsets' place in a code, by the fitted law. hidden: per
/// channel, or empty; where the step hides the noise, other errors hold. Reads the same and
/// dsnu_dn.
void widen_by_coarse_steps(double quantization_dn, const std::vector<HiddenNoise>& hidden,
                           PhysicsCalibration& out);

}  // namespace malus
