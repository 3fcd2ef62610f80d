// Opens the module with the networks (apps/networks/networks.h) on first need.
#pragma once

#include <filesystem>

#include "../networks/networks.h"

namespace malus::app {

/// The module's functions. Each opener defines it: the first call makes the process ready for
/// libtorch (network_environment.h) and opens the module. Throws InputError where it was not built.
const NetworkFunctions& networks();

/// Whether the module was built.
bool have_networks();

/// For those who define networks(): the module's file. Throws InputError where there is none.
std::filesystem::path networks_file();

struct OpenedNetworks {
  const NetworkFunctions* functions;
  std::string complaint;  ///< about the libraries that came along, to be said; may be empty
};

/// Opens that file. Throws InputError where it cannot be loaded or is of another version.
OpenedNetworks open_networks(const std::filesystem::path& path);

}  // namespace malus::app
