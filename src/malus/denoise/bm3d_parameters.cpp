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
    {"fast", {{6, 8, 8, 3.0F}, 2.7F, {6, 8, 16, 1.0F}}},
    {"normal", {{3, 19, 16, 3.0F}, 2.7F, {3, 19, 32, 1.0F}}},
    {"high", {{2, 19, 16, 3.0F}, 2.7F, {2, 19, 32, 1.0F}}},
}};

}  // namespace

const Bm3dParameters& bm3d_profile(std::string_view name) {
  for (const auto& profile : kProfiles)
    if (profile.name == name) return profile.parameters;
  throw InputError("profile", "'" + std::string(name) + "' is not known",
                   "use fast, normal or high");
}

}  // namespace malus::internal
