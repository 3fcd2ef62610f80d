// What a comparison of noise counts as noise that is none: sentences for whoever reads its numbers.
#pragma once

#include "malus/base/estimate.h"
#include "malus/evaluate/noise_comparison.h"

#include <string>
#include <vector>

namespace malus {

/// How many times the clean scene's light a frame shows: the slope of its values over the clean
/// ones, of all channels together, each about its own means. Undecided where the light that varies
/// is not above the noise (its variance below ten times that of the frame about the line), which
/// would take a mean of noisy frames for half of its light.
Estimate<double> light_over_clean(View<const float> frame_dn, View<const float> clean_dn,
                                  const SensorLayout& layout);

/// A clean scene of another light than the frames, by more than a quarter; else shading or a fixed
/// pattern of one side alone.
std::vector<std::string> cautions_of(const NoiseComparison& comparison,
                                     const NoiseComparisonSettings& settings);

}  // namespace malus
