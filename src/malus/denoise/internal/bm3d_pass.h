// BM3D with explicit parameters: what the profiles run and what the ablation varies.
#pragma once

#include "malus/denoise/bm3d.h"
#include "malus/denoise/internal/bm3d_parameters.h"

namespace malus::internal {

Bm3dReach bm3d_reach(const Bm3dParameters& parameters);

/// malus::bm3d with its parameters spelled out.
Planes bm3d_with(const Bm3dParameters& parameters, const Planes& noisy,
                 std::span<const float> sigma, std::span<const float> match_weights,
                 Progress& progress, Planes* variance_out);

}  // namespace malus::internal
