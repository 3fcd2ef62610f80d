// Opens the module with the networks (apps/networks/networks.h) on first need.
#pragma once

#include "../networks/networks.h"

namespace malus::app {

/// The module's functions. Call it before any work is done: the first call sets what libtorch and
/// its BLAS read when they are loaded, and for that starts this program anew where it has to
/// (the libraries of the picture formats load a BLAS of their own). What the user has
/// set in the environment stays. Throws InputError where the module was not built.
const NetworkFunctions& networks();

/// Whether the module was built.
bool have_networks();

}  // namespace malus::app
