// The methods that the default one is measured against: 000 Table 1's BM3D and MBM3D, and the usual
// calibrated pipelines without joint matching and row removal.
#pragma once

#include "malus/denoise/prepared_frame.h"

#include <string>

namespace malus::internal {

/// name: of denoise_methods(), not the default. The whole frame at once: throws InputError where
/// the memory setting is too small for that. Result: mosaic in DN above black.
Image run_baseline(const std::string& name, const PreparedFrame& frame, const NoiseProfile& profile,
                   const DenoiseSettings& settings, Progress& progress);

}  // namespace malus::internal
