// Noise models that ship with malus. Every one states its origin; docs/model-file.md lists sources
// and licences.
#pragma once

#include "malus/noise/model.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace malus {

struct BuiltinModel {
  std::string name;         ///< "imx250myr-simulated"
  std::string description;  ///< one line: sensor, gains, what the numbers are
  std::string licence;      ///< of the numbers
  NoiseModel (*make)();
};

/// All built-in models, in the order of `malus model list`.
const std::vector<BuiltinModel>& builtin_models();

std::vector<std::string> builtin_model_names();

/// The built-in model that a user means by "builtin:NAME", or by plain NAME where no file of that
/// name exists; empty when it is neither. Throws InputError for "builtin:" and an unknown name.
std::optional<NoiseModel> builtin_model_for(const std::filesystem::path& path);

}  // namespace malus
