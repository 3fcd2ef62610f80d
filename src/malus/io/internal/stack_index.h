// Which frame of a stack is meant.
#pragma once

#include "malus/io/frame_stack.h"

namespace malus::internal {

/// The index of the place in a file of this many frames. Throws InputError where there is no such
/// frame, or the place tells none of several.
int stack_index(const FramePlace& place, int frames);

}  // namespace malus::internal
