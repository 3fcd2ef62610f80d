// Settings structs (parameter.h) as C++ fills them: the program, files and Python check what they
// read; a member can be set to anything.
#pragma once

#include "malus/base/error.h"
#include "malus/base/parameter.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"

#include <algorithm>
#include <string>
#include <type_traits>
#include <vector>

#include <fmt/format.h>

namespace malus {

/// What to do about a number outside the setting's range, NaN among them; empty for one within.
inline std::string setting_remedy(double value, const ParameterInfo& info) {
  if (value >= info.minimum && value <= info.maximum) return {};
  return fmt::format("give {:g} to {:g}", info.minimum, info.maximum);
}

/// The same about a text that is none of the setting's choices.
inline std::string setting_remedy(const std::string& value, const ParameterInfo& info) {
  const auto& choices = info.choices;
  if (choices.empty() || std::find(choices.begin(), choices.end(), value) != choices.end())
    return {};
  return did_you_mean(value, choices, true) + "known: " + joined(choices);
}

/// Throws InputError naming the setting where there is a setting_remedy.
template <class Value>
void require_setting(const Value& value, const ParameterInfo& info) {
  if constexpr (requires { value.has_value(); }) {
    if (value) require_setting(*value, info);
  } else if constexpr (std::is_same_v<Value, std::vector<double>>) {
    for (const double part : value) require_setting(part, info);
  } else if (const std::string remedy = setting_remedy(value, info); !remedy.empty()) {
    constexpr bool kText = std::is_same_v<Value, std::string>;
    throw InputError(setting_name(info.name),
                     fmt::format("{} is {}", value, kText ? "not known" : "outside its range"),
                     remedy);
  }
}

/// The same of all settings.
template <class Settings>
void require_settings(const Settings& settings) {
  Settings::describe(
      settings, [](const auto& value, const ParameterInfo& info) { require_setting(value, info); });
}

}  // namespace malus
