// Stripes of the picture in the estimated offsets of row groups: a camera draws every group anew,
// so the offsets' spectrum is flat; stripes, steps and lines of a picture are peaks and slopes in
// it, over the whole frame or a part.
#pragma once

#include "malus/denoise/row_noise.h"

namespace malus {

/// Leaves in the picture what stands out of the flat spectrum, in windows of rows, and states what
/// that leaves of the camera's offsets. Fewer than 32 groups tell nothing: they stay as they are.
void leave_stripes_in(RowNoise& rows);

}  // namespace malus
