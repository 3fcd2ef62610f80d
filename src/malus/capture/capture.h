// Takes the frames of a plan and writes the session file that calibrate reads.
#pragma once

#include "malus/base/progress.h"
#include "malus/capture/plan.h"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace malus {

/// What one step gave: the live check, from every frame.
struct StepReport {
  CaptureStep step;
  double gain_db = 0, exposure_s = 0, frame_rate_hz = 0;  ///< as the camera reports them
  int taken = 0, kept = 0;                                ///< new frames; frames of an earlier run
  std::int64_t lost = 0;  ///< frames that the camera sent in vain; others replace them
  /// Of the new frames; none without one, and no noise of a single one.
  std::optional<double> mean_dn, temporal_sd_dn, saturated_share;
};

struct CaptureReport {
  std::string camera, pixel_format;
  std::vector<StepReport> steps;
  std::filesystem::path session;
};

/// Who stands at the camera.
struct CaptureWatcher {
  /// The first frames of an entry with a prompt are about to be taken: "cover the lens". Given its
  /// first step.
  std::function<void(const CaptureStep&)> ask = [](const CaptureStep&) {};
  /// The live check: the step so far, about once a second and at its end.
  std::function<void(const StepReport&)> watch = [](const StepReport&) {};
};

/// Checks the plan against the camera before the first frame: ranges, pixel format, that the size
/// is taken as it is asked for, and every step's gain and exposure at the plan's frame rate; sets
/// black level, size and features, turns automatic functions off; at each step waits for settings
/// to settle, streams, and writes <folder>/<kind>/g<gain>/e<exposure>/f000001.tif. Whole frames of
/// an interrupted run of the same plan are kept. Memory does not grow with the number of frames.
/// Throws InputError (camera, plan, folder of another plan) or Cancelled; then what is written is
/// whole and a new call continues.
CaptureReport capture(const CapturePlan& plan, const std::filesystem::path& folder,
                      const CaptureWatcher& watcher, Progress& progress);

}  // namespace malus
