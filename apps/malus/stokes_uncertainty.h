// The confidence outputs of malus stokes: standard deviations of DoLP and AoLP, corrected DoLP.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/noise/model.h"
#include "malus/polar/render.h"
#include "malus/polar/stokes.h"
#include "malus/polar/uncertainty.h"

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace malus::app {

inline constexpr std::array<const char*, 3> kConfidenceProducts = {"dolp_sd", "aolp_sd",
                                                                   "dolp_corrected"};

/// Variance of every packed pixel of a noisy frame by the model at the frame's gain: the variance
/// curve at the pixel itself, row noise added as if independent. Throws InputError when the gain is
/// not known or the layouts differ.
Planes variance_by_model(const RawFrame& frame, const NoiseModel& model, GainRange range);

/// Packed planes that malus denoise --uncertainty wrote, in the layout's order.
Planes load_variance(const std::filesystem::path& path, const RawFrame& frame);

/// kConfidenceProducts, one image per display channel each.
std::array<Planes, 3> confidence_of(const StokesPicture& picture, const Planes& packed_variance,
                                    const SensorLayout& layout, Intensities intensities);

/// Their pictures: means over the display channels.
std::array<Planes, 3> confidence_pictures(const std::array<Planes, 3>& data,
                                          const RenderSettings& settings);

}  // namespace malus::app
