// Speed against quality, by name: of BM3D, of the default method, and of the guides of networks.
#pragma once

#include <string>
#include <vector>

namespace malus {

enum class DenoiseProfile { kFast, kNormal, kHigh };

/// In that order.
const std::vector<std::string>& denoise_profile_names();

/// Throws InputError on another name.
DenoiseProfile denoise_profile(const std::string& name);

}  // namespace malus
