// Session -> noise model (000, 3.2 and 3.3): the main path of calibration. docs/calibration.md
// derives every estimator.
#pragma once

#include "malus/base/parameter.h"
#include "malus/base/progress.h"
#include "malus/calibrate/frame_set.h"
#include "malus/noise/model.h"

#include <string>
#include <vector>

namespace malus {

struct CalibrationSettings {
  double saturation_limit = 0.7;
  std::string shape = "likelihood";
  bool single_frame = false;
  bool maps = true;
  double level_step = 0;
  int bins = 240;
  int level_samples = 200000;
  int dark_frames = 16;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.saturation_limit,
          ParameterInfo{"saturation_limit", "1",
                        "flat levels above this share of the range between black and white are not "
                        "used for the gain",
                        0.05, 1.0});
    field(self.shape,
          ParameterInfo{.name = "shape",
                        .unit = "",
                        .help = "estimator of the Tukey-lambda shape: maximum likelihood, or the "
                                "papers' probability-plot correlation (ppcc)",
                        .choices = {"likelihood", "ppcc"}});
    field(self.single_frame,
          ParameterInfo{"single_frame", "",
                        "estimate every bias frame alone, its fixed pattern included, as the "
                        "papers do"});
    field(self.maps, ParameterInfo{"maps", "", "store dark-shading and PRNU maps in the model"});
    field(self.level_step,
          ParameterInfo{"level_step", "DN",
                        "non-parametric, and Gaussian from bursts: distance of signal levels; 0 = "
                        "1/256 of the range",
                        0.0, 65536.0});
    field(self.bins,
          ParameterInfo{"bins", "1",
                        "non-parametric: about this many bins per distribution; about 14 at least, "
                        "and fewer where the camera's codes are wider",
                        8, 4096});
    field(self.level_samples,
          ParameterInfo{"level_samples", "1",
                        "non-parametric: samples wanted per level; levels with fewer borrow from "
                        "their neighbours, below a tenth they are left out (Gaussian from bursts: "
                        "2000 where more are asked for)",
                        10, 1e9});
    field(self.dark_frames,
          ParameterInfo{"dark_frames", "1", "dark-frames: bias frames stored per gain", 1, 1000});
  }
};

/// A gain's warning that concerns the physics model alone: other kinds may know their slope.
inline constexpr const char* kWithoutFlats = "no flat frames at this gain: K is not known";

/// The physics model of all gains in the input, row group detected when it is not declared, joint
/// model over gain where there are two gains or more. What the data say about themselves (drift,
/// light leaks, saturated or missing levels) stands in the warnings of each gain. Throws InputError
/// when there are no bias frames, frames do not belong together, or a setting is outside its range.
NoiseModel calibrate_physics(const CalibrationInput& input, const CalibrationSettings& settings,
                             Progress& progress);

/// The kinds of model asked for, one or more; another order or a repetition changes nothing.
/// Gaussian: slope K and the whole temporal dark variance, from the physics results; at gains
/// without flats a line through the variances of a burst's signal levels.
/// Non-parametric: from bias frames, flats and bursts of each gain (001, S1-S2); bias frames may be
/// missing when nothing that needs_bias_frames is asked for. Throws InputError as
/// calibrate_physics, and where no gain has frames for a kind.
NoiseModel calibrate(const CalibrationInput& input, const CalibrationSettings& settings,
                     const std::vector<ModelKind>& kinds, Progress& progress);

}  // namespace malus
