#include "malus/denoise/internal/bm3d_parameters.h"

#include "malus/base/error.h"

#include <array>
#include <string>

namespace malus::internal {
namespace {

struct NamedParameters {
  std::string_view name;
  Bm3dParameters parameters;
};

constexpr std::array<NamedParameters, 3> kProfiles = {{
    // Small groups and a narrow search, paid back by a denser lattice and a higher threshold
    // (docs/bm3d.md).
    {"fast", {{8, 4, 16, 16.0F}, 3.1F, {6, 3, 8, 4.0F}}},
    {"normal", {{3, 19, 16, 16.0F}, 2.8F, {3, 19, 32, 4.0F}}},
    {"high", {{2, 25, 16, 16.0F}, 2.8F, {2, 25, 32, 4.0F}}},
}};

}  // namespace

const Bm3dParameters& bm3d_profile(std::string_view name) {
  for (const auto& profile : kProfiles)
    if (profile.name == name) return profile.parameters;
  throw InputError("profile", "'" + std::string(name) + "' is not known",
                   "use fast, normal or high");
}

}  // namespace malus::internal
