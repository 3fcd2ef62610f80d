// Column noise: as row noise (row_noise.h), by the same estimator on the frame with its rows and
// columns exchanged; a group is one column. The two do not disturb each other: the differences that
// tell rows are taken inside columns, where a column's offset cancels, and the reverse.
#pragma once

#include "malus/denoise/frame_profile.h"
#include "malus/denoise/row_noise.h"

#include <optional>
#include <vector>

namespace malus {

/// As estimate_row_noise; offsets per column, in units of the channels' sigma_column.
RowNoise estimate_column_noise(View<const float> dn, const NoiseProfile& profile,
                               const std::vector<float>& saturated_dn);

/// Subtracts sigma_column * offset from every pixel that is not saturated.
void remove_column_noise(View<float> dn, const NoiseProfile& profile, const RowNoise& columns,
                         const SaturatedPixels& saturated);

/// As shown_row_variance, of the columns' offsets in units of the channels' sigma_column². dn:
/// above black and bias.
std::optional<ShownRowVariance> shown_column_variance(View<const float> dn,
                                                      const NoiseProfile& profile,
                                                      const std::vector<float>& saturated_dn);

}  // namespace malus
