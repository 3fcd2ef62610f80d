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
    {"fast", {{6, 8, 8, 4.0F}, 2.8F, {6, 8, 16, 0.8F}}},
    {"normal", {{3, 19, 16, 4.0F}, 2.8F, {3, 19, 32, 0.8F}}},
    {"high", {{2, 19, 16, 4.0F}, 2.8F, {2, 19, 32, 0.8F}}},
}};

}  // namespace

const Bm3dParameters& bm3d_profile(std::string_view name) {
  for (const auto& profile : kProfiles)
    if (profile.name == name) return profile.parameters;
  throw InputError("profile", "'" + std::string(name) + "' is not known",
                   "use fast, normal or high");
}

}  // namespace malus::internal
