// Noise of the mean of several frames of a scene that stood still. What is drawn anew in every
// frame falls to 1/sqrt(frames): shot noise, read, row and column noise, rounding that noise
// dithers. Bias, PRNU and DSNU are in every frame alike and stay, and so does K, the camera's DN
// per electron.
#pragma once

#include "malus/noise/profile.h"

namespace malus {

/// Of the pixels of a mean: as computed, or rounded to codes again, as by a camera that averages.
enum class MeanValues { kExact, kRounded };

/// profile: of one frame; frames >= 1, and 1 gives it back as it is. Before its fixed pattern is
/// counted as noise (add_pattern_noise). A mean shows the bias of what a camera cuts off at 0, so
/// that counts as nothing special.
NoiseProfile mean_of_frames(NoiseProfile profile, int frames,
                            MeanValues values = MeanValues::kExact);

}  // namespace malus
