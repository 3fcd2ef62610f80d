// The confidence outputs of malus stokes: standard deviations of DoLP and AoLP, corrected DoLP.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/io/frame_file.h"
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

/// Takes the model's bias at the frame's gain off a noisy frame above black, but for saturated
/// pixels. Returns the variance of every packed pixel: the variance curve at the pixel itself, row
/// noise added as if independent; NaN for saturated pixels. Throws InputError when the gain is not
/// known or the layouts differ.
Planes take_out_bias(RawFrame& above_black, const NoiseModel& model, GainRange range);

/// Packed planes that malus denoise --uncertainty wrote, in the layout's order; NaN where the frame
/// is saturated.
Planes load_variance(const std::filesystem::path& path, const RawFrame& above_black);

/// by_model (--model, else --variance): throws InputError for a file that says it is denoised,
/// since the model's noise is no longer in it. Else warns of integers that do not say so.
void check_noise_source(const std::filesystem::path& input, const FrameOptions& options,
                        bool by_model);

/// kConfidenceProducts, one image per display channel each.
std::array<Planes, 3> confidence_of(const StokesPicture& picture, const Planes& packed_variance,
                                    const SensorLayout& layout, Intensities intensities);

/// Their pictures: means over the display channels.
std::array<Planes, 3> confidence_pictures(const std::array<Planes, 3>& data,
                                          const RenderSettings& settings);

}  // namespace malus::app
