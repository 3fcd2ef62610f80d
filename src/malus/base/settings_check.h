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

/// Throws InputError naming the setting where a number lies outside its range, NaN among them, or a
/// text is none of its choices.
template <class Value>
void require_setting(const Value& value, const ParameterInfo& info) {
  if constexpr (requires { value.has_value(); }) {
    if (value) require_setting(*value, info);
  } else if constexpr (std::is_same_v<Value, std::vector<double>>) {
    for (const double part : value) require_setting(part, info);
  } else if constexpr (std::is_same_v<Value, std::string>) {
    if (!info.choices.empty() &&
        std::find(info.choices.begin(), info.choices.end(), value) == info.choices.end())
      throw InputError(setting_name(info.name), fmt::format("{} is not known", value),
                       "choose one of " + joined(info.choices));
  } else if constexpr (!std::is_same_v<Value, bool>) {
    const auto number = static_cast<double>(value);
    if (!(number >= info.minimum && number <= info.maximum))
      throw InputError(setting_name(info.name), fmt::format("{} is outside its range", value),
                       fmt::format("give {:g} to {:g}", info.minimum, info.maximum));
  }
}

/// The same of all settings.
template <class Settings>
void require_settings(const Settings& settings) {
  Settings::describe(
      settings, [](const auto& value, const ParameterInfo& info) { require_setting(value, info); });
}

}  // namespace malus
