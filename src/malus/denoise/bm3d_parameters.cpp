#include "malus/denoise/internal/bm3d_parameters.h"

#include <array>

namespace malus::internal {
namespace {

// In the order of DenoiseProfile.
constexpr std::array<Bm3dParameters, 3> kProfiles = {{
    // Small groups and a narrow search, paid back by a denser lattice and a higher threshold
    // (docs/bm3d.md).
    {{8, 4, 16, 16.0F}, 3.1F, {6, 3, 8, 4.0F}},
    {{3, 19, 16, 16.0F}, 2.8F, {3, 19, 32, 4.0F}},
    {{2, 25, 16, 16.0F}, 2.8F, {2, 25, 32, 4.0F}},
}};

}  // namespace

const Bm3dParameters& bm3d_profile(DenoiseProfile profile) {
  return kProfiles[static_cast<std::size_t>(profile)];
}

}  // namespace malus::internal
