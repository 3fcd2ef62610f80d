// Levels and gain of a frame that is read with its sensor's noise model: what neither the user nor
// the file states comes from the model.
#pragma once

#include "malus/noise/model.h"

#include <string>
#include <vector>

namespace malus {

/// Fills in layout, black and white of a frame of the model's sensor where they are not known.
/// Floats of unknown black that are no mean of codes (holds_codes) are DN above it already, as
/// malus writes them: black becomes 0, and white is the model's above its black. Returns what to
/// warn of (without the frame's name), for the case that they are not; empty otherwise.
/// white_stated: the frame's white is the user's word, black level included, and becomes less with
/// it. Throws InputError where frame and model have different layouts, or the levels contradict
/// each other.
std::string take_levels_of_model(const NoiseModel& model, RawFrame& frame,
                                 bool white_stated = false);

/// Throws InputError where the frame knows that it was taken at another gain than it is said to be.
/// asked: the name of what says so.
void require_gain(const RawFrame& frame, const GainSetting& told, const std::string& asked);

/// That the model does not tell the gain it was calibrated at, and stands for these, whatever they
/// are: its one gain's noise is drawn and taken off as theirs. Unknown ones are left out. Empty
/// where the model tells its gains or none is asked for. Without the model's name.
std::string untold_gain_complaint(const NoiseModel& model, const std::vector<GainSetting>& asked);

}  // namespace malus
