// What a network gives, by name. Names no libtorch type.
#pragma once

#include "malus/base/error.h"
#include "malus/base/text.h"

#include <algorithm>
#include <array>
#include <string>
#include <string_view>
#include <vector>

namespace malus {

/// A denoised mosaic; or a picture of the mosaic's size, of linear light or as displayed.
enum class NetworkTarget { kMosaic, kRgb, kSrgb };
/// Their names, in that order.
inline constexpr std::array<std::string_view, 3> kNetworkTargetNames = {"mosaic", "rgb", "srgb"};

inline std::string network_target_name(NetworkTarget target) {
  return std::string(kNetworkTargetNames[static_cast<std::size_t>(target)]);
}

/// Throws InputError on another name.
inline NetworkTarget network_target(std::string_view name) {
  const auto found = std::ranges::find(kNetworkTargetNames, name);
  if (found == kNetworkTargetNames.end())
    throw InputError("target", "'" + std::string(name) + "' is not known",
                     "known: " + joined(std::vector<std::string>(kNetworkTargetNames.begin(),
                                                                 kNetworkTargetNames.end())));
  return static_cast<NetworkTarget>(found - kNetworkTargetNames.begin());
}

}  // namespace malus
