// Column noise: offsets of whole columns that are drawn anew in every frame. Calibration measures
// their deviation, sigma_column, and the read noise that it fits to single pixels holds them:
// synthesis draws them as noise of pixels, a denoiser can tell them apart.
#pragma once

#include "malus/noise/model.h"

#include <vector>

namespace malus {

/// Per channel, share of the read noise's variance that is column noise, 0 to below 1. All 0 unless
/// sigma_column is more than five standard errors and 3 % of the read noise (means over the
/// channels).
std::vector<double> column_noise_shares(const PhysicsCalibration& calibration);

/// The same at a gain: as measured there, or interpolated in dB between the two measured gains
/// around it, that of the nearest outside. Contract: the model has parameters at this gain.
std::vector<double> column_noise_shares_at(const NoiseModel& model, const GainSetting& gain);

}  // namespace malus
