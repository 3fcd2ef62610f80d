// The confidence outputs of malus stokes: standard deviations of S0, S1, S2, DoLP and AoLP,
// corrected DoLP.
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

#include "frame_input.h"

namespace malus::app {

inline constexpr std::array kConfidenceProducts = {"s0_sd",   "s1_sd",   "s2_sd",
                                                   "dolp_sd", "aolp_sd", "dolp_corrected"};
/// One entry per product, in their order.
using Confidence = std::array<Planes, kConfidenceProducts.size()>;

/// What is known of the errors of a frame's pixels.
struct PixelErrors {
  Planes variance;          ///< packed [DN²]; NaN where the raw frame was saturated
  SharedOffsets offsets{};  ///< the part that rows and columns share; none of denoised frames
};

/// take_out_bias (malus/noise/raw_variance.h) with the model's profile at the frame's gain, and the
/// errors of its pixels, those of the fixed pattern among them or not. Throws InputError when the
/// gain is not known or the layouts differ.
PixelErrors take_out_bias(FrameAsLight& light, const NoiseModel& model, GainRange range,
                          bool fixed_pattern);

/// Packed planes that malus denoise --uncertainty wrote of the frame, in the layout's order; NaN
/// where the raw frame was saturated.
Planes load_variance(const std::filesystem::path& path, const RawFrame& frame);

/// by_model (--model, else --variance): throws InputError for a file that says it is denoised,
/// since the model's noise is no longer in it. Else warns of integers that do not say so.
void check_noise_source(const std::filesystem::path& input, const FrameOptions& options,
                        bool by_model);

/// kConfidenceProducts, one image per display channel each.
Confidence confidence_of(const std::vector<StokesUncertainty>& uncertainty);

/// Their pictures, of the mean of the display channels (uncertainty_of_mean); those of S0, S1 and
/// S2 on one scale.
Confidence confidence_pictures(const StokesUncertainty& mean, const RenderSettings& settings);

}  // namespace malus::app
