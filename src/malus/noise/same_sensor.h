// A noise model describes one sensor; frames of another are refused, everywhere in the same words.
#pragma once

#include "malus/image/raw_frame.h"

namespace malus {

/// Throws InputError where the frame's layout is not the noise model's.
void require_layout_of_model(const RawFrame& frame, const SensorLayout& model_layout);

}  // namespace malus
