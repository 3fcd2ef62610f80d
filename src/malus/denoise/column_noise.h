// Column noise: as row noise (row_noise.h), by the same estimator on the frame with its rows and
// columns exchanged; a group is one column. The two do not disturb each other: the differences that
// tell rows are taken inside columns, where a column's offset cancels, and the reverse.
#pragma once

#include "malus/denoise/row_noise.h"
#include "malus/image/raw_frame.h"
#include "malus/noise/model.h"

namespace malus {

/// As estimate_row_noise; offsets per column, in units of the channels' sigma_column.
RowNoise estimate_column_noise(View<const float> dn, const NoiseProfile& profile,
                               const std::vector<float>& saturated_dn);

/// Subtracts sigma_column * offset from every pixel that is not saturated.
void remove_column_noise(View<float> dn, const NoiseProfile& profile, const RowNoise& columns,
                         const SaturatedPixels& saturated);

/// The model's profile for a frame that is to be denoised: with column noise apart, unless the
/// frame shows clearly less than half of its deviation. Such a frame is of another state of the
/// camera, or of synthesis, which draws column noise as noise of pixels. Throws InputError as
/// NoiseModel::profile_at and require_levels (image/black_levels.h).
NoiseProfile denoising_profile(const RawFrame& frame, const NoiseModel& model,
                               const GainSetting& gain,
                               GainRange range = GainRange::kCalibratedOnly);

}  // namespace malus
