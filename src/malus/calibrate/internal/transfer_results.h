// From the photon-transfer lines of a gain's channels to what its calibration tells of K.
#pragma once

#include "malus/base/estimate.h"
#include "malus/calibrate/internal/photon_transfer.h"
#include "malus/image/layout.h"
#include "malus/noise/calibration.h"

#include <string>
#include <vector>

namespace malus {

/// The reason against the most of these levels, "3 of 4: one frame has ..."; empty where all count.
std::string most_frequent_reason(const std::vector<TransferLevel>& levels);

/// One channel's levels into transfer of `out`. fit: of these levels.
void append_transfer(int channel, const Estimate<TransferFit>& fit,
                     const std::vector<TransferLevel>& levels, PhysicsCalibration& out);

/// The fits of all channels into K and its intercepts, which stay empty where one has none; one
/// warning for all channels that have the same trouble, and one where the exposures seem to be in
/// two units. levels: [channel][level]. Contract: all
/// channels' transfer is appended.
void append_fits(const std::vector<Estimate<TransferFit>>& fits,
                 const std::vector<std::vector<TransferLevel>>& levels, const SensorLayout& layout,
                 PhysicsCalibration& out);

}  // namespace malus
