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
    {"fast", {{8, 6, 16, 16.0F}, 2.8F, {8, 6, 16, 4.0F}}},
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
