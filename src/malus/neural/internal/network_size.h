// How large a network its settings describe, before anything is built: settings come from weight
// files and configurations, and a digit too many would take all memory.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

namespace malus {

/// Settings with every key present. Throws InputError, naming the setting, where one is outside its
/// range or a list has the wrong length. The ranges are far beyond every published network.
void check_network_settings(const std::string& architecture, const nlohmann::json& settings);

/// A lower bound of the values in the network's weights: those of the layers whose size grows
/// with the square of the channels, or with the fourth power of the window. All of them are no more
/// than a few times that. Contract: the settings are checked.
double least_network_values(const std::string& architecture, const nlohmann::json& settings);

}  // namespace malus
