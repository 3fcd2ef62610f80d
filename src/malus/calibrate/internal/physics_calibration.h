// The physics model with what other kinds of model, made of the same frames, count from.
#pragma once

#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/frame_set.h"
#include "malus/noise/model.h"

namespace malus {

struct CalibratedPhysics {
  NoiseModel model;
  FrameFormat format;  ///< of the highest gain's bias frames, with the model's white
};

/// calibrate_physics.
CalibratedPhysics physics_with_format(const CalibrationInput& input,
                                      const CalibrationSettings& settings, Progress& progress);

}  // namespace malus
