// A noise model describes one sensor; frames of another are refused, everywhere in the same words.
#pragma once

#include "malus/image/raw_frame.h"

#include <string>

namespace malus {

/// Throws InputError where the frame's layout is not the noise model's.
void require_layout_of_model(const RawFrame& frame, const SensorLayout& model_layout);

/// That the frame was declared to have another layout than its file tells, for a warning; empty
/// where it was not.
std::string declaration_note(const RawFrame& frame);

/// A loaded frame whose layout neither file nor flag tells gets the model's, and its black levels
/// for it (image/black_levels.h); any other must have the model's already, else InputError.
void take_layout_of_model(RawFrame& frame, const SensorLayout& model_layout);

}  // namespace malus
