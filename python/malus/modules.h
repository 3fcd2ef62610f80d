// The parts that this module opens on first need (apps/doors): the networks, and the codecs of
// pictures.
#pragma once

#include <string>

namespace malus::python {

/// Finds out where they lie, while the folder that the package was found from is still the same.
void remember_modules();

/// What opening the networks said about the libraries that came along, once; empty else.
std::string take_networks_complaint();

}  // namespace malus::python
