// The numbers behind BM3D's profiles.
#pragma once

#include "malus/denoise/denoise_profile.h"

namespace malus::internal {

inline constexpr int kPatch = 8;  ///< rows and columns of a block
inline constexpr int kPatchPixels = kPatch * kPatch;
inline constexpr int kMaxGroup = 32;  ///< blocks in a group
/// The match limit in the matching's own integer units: sums of squares saturate at 65535.
inline constexpr int kMatchFullScale = 40000;

/// One pass: match blocks, filter the groups, aggregate.
struct Bm3dStage {
  int step;           ///< pixels between reference blocks, 1 to 8
  int range;          ///< candidates lie within ± range pixels
  int group;          ///< most blocks in a group, a power of two up to kMaxGroup
  float match_limit;  ///< largest mean squared difference of a match, in noise variances
};

struct Bm3dParameters {
  Bm3dStage hard;
  float hard_threshold;  ///< λ3D: coefficients below this many deviations are noise
  Bm3dStage wiener;
};

const Bm3dParameters& bm3d_profile(DenoiseProfile profile);

}  // namespace malus::internal
