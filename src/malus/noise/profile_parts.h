// What a denoiser is told of noise that a part was left out of: training on drawn noise leaves out
// what its configuration, or that of a data set, switches off.
#pragma once

#include "malus/noise/model.h"

namespace malus {

/// As NoiseModel::profile_at, without the parts that are off. Of a non-parametric model, whose
/// levels are measured as a whole, rows and bias alone can be. Throws InputError as profile_at.
NoiseProfile profile_of_parts(const NoiseModel& model, const GainSetting& gain, GainRange range,
                              const PhysicsParts& parts);

}  // namespace malus
