// Published and own sizes of the architectures, by name. Names no libtorch type.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus {

struct NamedNetwork {
  std::string name, architecture;
  nlohmann::json settings;  ///< where they differ from the architecture's defaults
};
/// The sizes of docs/networks.md: unet, nafnet-32, uformer-t, -s, -b, restormer, malus-small,
/// malus-base, all with 16 channels in and out.
std::vector<NamedNetwork> named_networks();

/// The one of that name; of any other name an architecture with its defaults.
NamedNetwork network_of_name(const std::string& name);

}  // namespace malus
