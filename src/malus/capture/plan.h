// What to capture: gains x exposures x frames of each kind, read from a TOML plan
// (docs/capture.md).
#pragma once

#include "malus/io/session.h"

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace malus {

/// Frames of one kind at one gain and exposure: one group of the session that results.
struct CaptureStep {
  FrameKind kind = FrameKind::kBias;
  double gain_db = 0;
  double exposure_s = 0;
  int frames = 0;
  std::optional<int> level;  ///< light level: flats number their exposures
  std::string prompt;        ///< of an entry's first step: "cover the lens"
  int entry = 0;             ///< its [[capture]], from 0
  /// "bias/g24/e0.01": folder of its frames, unique in the plan
  std::string folder() const;
};

struct CapturePlan {
  SensorDescription sensor;
  std::string camera;                 ///< as the list of cameras names it; empty = the first found
  std::string pixel_format;           ///< empty = the deepest that can be read
  std::optional<double> black_level;  ///< in the camera's own unit
  std::optional<double> frame_rate_hz;  ///< empty = the highest at each exposure
  int settle_frames = 3;                ///< thrown away after each change of settings
  int width = 0, height = 0;            ///< 0 = the whole sensor
  std::vector<std::pair<std::string, std::string>>
      features;                    ///< further GenICam features, set in order
  std::vector<CaptureStep> steps;  ///< in the order of the file, gains outside exposures
  std::filesystem::path source;
};

/// Throws InputError that names the key: unknown keys, wrong types, no frames, two steps that would
/// share a folder.
CapturePlan load_capture_plan(const std::filesystem::path& path);

}  // namespace malus
