// What `malus denoise` looks at before and after a frame, and says on stderr.
#pragma once

#include "malus/denoise/denoiser.h"
#include "malus/image/raw_frame.h"
#include "malus/neural/inference.h"
#include "malus/noise/model.h"

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus::app {

/// Cuts the profile's defects and maps to the frame, whose first pixel lies at `origin` (row,
/// column) on the sensor; where that is empty, says that those of a sensor of another size are left
/// out. Throws InputError.
void fit_to_sensor(NoiseProfile& profile, const RawFrame& frame, const std::vector<int>& origin,
                   bool fill_defects);

/// Says that the gain lies outside the calibrated range, or that the model does not tell its own.
/// profile_at refuses a gain outside unless --extrapolate-gain asks for it.
void warn_of_extrapolation(const NoiseModel& model, const GainSetting& gain,
                           const std::filesystem::path& path);

/// Says where the model's bias at this gain is that of dark frames that the camera cut off at 0;
/// undone: whether the caller works with what it was before.
void warn_of_clipped_dark(const NoiseModel& model, const GainSetting& gain,
                          const std::filesystem::path& path, bool undone);

/// Says what a result tells against its frame, its profile or the network that made it; `network`
/// is that one's file, empty where a filter did. `before` needs no pixels.
void warn_of_result(const RawFrame& before, const Denoised& result, const NoiseProfile& profile,
                    const std::string& network = "");

/// The same of a frame that a network made a picture of.
void warn_of_picture(const std::string& source, const NetworkInference::Rendered& made);

/// The comparison of the frame's noise with the profile's, for the record; null where none is.
nlohmann::ordered_json noise_json(const Denoised& result);

/// What a run's record says for people: one line, and a row per metric that was measured against a
/// reference.
std::string run_text(const nlohmann::ordered_json& run, const std::string& method);

/// Those of the files that exist and are none of the others.
std::vector<std::filesystem::path> existing_apart(const std::vector<std::filesystem::path>& files,
                                                  const std::vector<std::filesystem::path>& others);

}  // namespace malus::app
