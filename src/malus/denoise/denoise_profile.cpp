#include "malus/denoise/denoise_profile.h"

#include "malus/base/error.h"
#include "malus/base/text.h"

#include <algorithm>

namespace malus {

const std::vector<std::string>& denoise_profile_names() {
  static const std::vector<std::string> names = {"fast", "normal", "high"};
  return names;
}

DenoiseProfile denoise_profile(const std::string& name) {
  const auto& names = denoise_profile_names();
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end())
    throw InputError("profile", "'" + name + "' is not known", "known: " + joined(names));
  return static_cast<DenoiseProfile>(found - names.begin());
}

}  // namespace malus
