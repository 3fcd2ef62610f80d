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

/// Throws CLI::ValidationError, naming what asks for it, unless the method states its error or is a
/// network, which is asked when its file is open: no file could make the two go together.
void check_states_error(const std::string& asked, const std::string& method);

/// Says complaints_at_gain (malus/denoise/frame_complaints.h) of the model of this file.
void warn_of_model(const NoiseModel& model, const GainSetting& gain,
                   const std::filesystem::path& path, bool undone);

/// Says result_complaints (malus/denoise/frame_complaints.h).
void warn_of_result(const RawFrame& before, const Denoised& result, const NoiseProfile& profile,
                    const std::string& network = "");

/// The same of a frame that a network made a picture of.
void warn_of_picture(const std::string& source, const NetworkInference::Rendered& made);

/// The comparison of the frame's noise with the profile's, for the record; null where none is.
nlohmann::ordered_json noise_json(const Denoised& result);

/// What is told of a frame's run.
struct RunSummary {
  const RawFrame& frame;   ///< its pixels are not asked for
  const Denoised& result;  ///< nor are these
  int rows, cols;          ///< of what was made
  double seconds;
};

/// One line for people. file: what was made.
std::string run_text(const RunSummary& run, const std::string& method,
                     const std::filesystem::path& file);

}  // namespace malus::app
