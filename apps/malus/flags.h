// Settings structs (base/parameter.h) to flags and to JSON.
#pragma once

#include "malus/base/parameter.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <type_traits>

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace malus::app {

inline std::string flag_name(std::string name) {
  std::replace(name.begin(), name.end(), '_', '-');
  return "--" + name;
}

/// One flag per described field, of a bool two (--x and --no-x); ranges and choices are checked by
/// the parser.
template <class Settings>
void add_flags(CLI::App& command, Settings& settings) {
  Settings::describe(settings, [&](auto& value, const ParameterInfo& info) {
    using Value = std::decay_t<decltype(value)>;
    const std::string unit =
        info.unit.empty() || info.unit == "1" ? "" : fmt::format(" [{}]", info.unit);
    if constexpr (std::is_same_v<Value, bool>) {
      command.add_flag(
          fmt::format("{},!--no-{}", flag_name(info.name), flag_name(info.name).substr(2)), value,
          fmt::format("{} (default: {})", info.help, value ? "on" : "off"));
    } else {
      CLI::Option* option = command.add_option(flag_name(info.name), value, info.help + unit);
      if (!info.choices.empty()) option->check(CLI::IsMember(info.choices));
      if (std::isfinite(info.minimum) || std::isfinite(info.maximum))
        option->check(CLI::Range(info.minimum, info.maximum));
      if constexpr (!requires { value.has_value(); }) option->capture_default_str();
    }
  });
}

template <class Settings>
nlohmann::ordered_json settings_json(const Settings& settings) {
  nlohmann::ordered_json json;
  Settings::describe(settings, [&](const auto& value, const ParameterInfo& info) {
    if constexpr (requires { value.has_value(); })
      json[info.name] = value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json();
    else
      json[info.name] = value;
  });
  return json;
}

}  // namespace malus::app
