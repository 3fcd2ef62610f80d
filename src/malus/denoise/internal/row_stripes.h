// Stripes of the picture in the estimated offsets of row groups: a camera draws every group anew,
// so the offsets' spectrum is flat, or that of its drift; stripes, steps and lines of a picture are
// peaks and slopes in it, over the whole frame or a part.
#pragma once

#include "malus/denoise/row_noise.h"
#include "malus/noise/row_drift.h"

namespace malus {

/// Leaves in the picture what stands out of the camera's spectrum, in windows of rows, and states
/// what that leaves of its offsets. drift: as far as it is known; rows that drift as those of a
/// measured camera do stay without it too, but for a few hundredths. Fewer than 32 groups tell
/// nothing: they stay as they are.
void leave_stripes_in(RowNoise& rows, const RowDrift& drift = {});

}  // namespace malus
