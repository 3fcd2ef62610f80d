// Checks of numeric flags; settings structs (base/parameter.h) to flags and to JSON.
#pragma once

#include "malus/base/error.h"
#include "malus/base/frame_numbers.h"
#include "malus/base/parameter.h"
#include "malus/base/wording.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace malus::app {

// Every numeric flag of the program is checked by one of these four and by none of CLI11's own:
// CLI11's Range and PositiveNumber let NaN pass, print the largest double with 300 digits, and its
// conversions read 0x10 as 16, 010 as 8 and -1 as 2^64 - 1.

/// A number from minimum to maximum, both included; an infinite end is open, but infinity itself is
/// refused. Described in --help as CLI::Range does.
CLI::Validator in_range(double minimum, double maximum);
CLI::Validator in_range(int minimum, int maximum);
/// A finite number above 0.
CLI::Validator positive_number();
/// Any number but NaN and infinity.
CLI::Validator finite_number();
/// A whole number from 0 to maximum.
CLI::Validator counting_number(std::uint64_t maximum);

/// A camera's gain in dB (fault_of, malus/io/session.h).
CLI::Validator gain_in_db();
/// The number of a frame or scene.
CLI::Validator frame_number();

/// One of these words; of another the one that was probably meant is told, and all. Described in
/// --help as CLI::IsMember does.
CLI::Validator one_of(std::vector<std::string> choices);

/// A text that `read` takes; its InputErrors are told as wrong usage: no file can make such a value
/// right.
CLI::Validator accepted_by(std::function<void(const std::string&)> read);

/// work(), whose InputErrors are told as wrong usage, too.
template <class Work>
void as_usage(const Work& work) {
  try {
    work();
  } catch (const InputError& error) {
    throw CLI::ValidationError(error.subject(), error.problem() + "; " + error.remedy());
  }
}

/// The values that Settings allows for its field of this name.
template <class Settings>
std::vector<std::string> choices_of(std::string_view name) {
  std::vector<std::string> choices;
  const Settings settings;
  Settings::describe(settings, [&](const auto&, const ParameterInfo& info) {
    if (info.name == name) choices.assign(info.choices.begin(), info.choices.end());
  });
  return choices;
}

inline std::string flag_name(std::string name) {
  std::replace(name.begin(), name.end(), '_', '-');
  return "--" + name;
}

/// Messages of the library name settings as flags.
extern const Wording kFlagWording;

/// Whether a described field is a number, or holds some.
template <class Value>
constexpr bool holds_numbers() {
  if constexpr (requires { typename Value::value_type; })
    return std::is_arithmetic_v<typename Value::value_type> && !std::is_same_v<Value, std::string>;
  else
    return std::is_arithmetic_v<Value>;
}

/// A limit of a whole number; an open one is that of int.
inline int whole_limit(double limit) {
  return static_cast<int>(std::clamp(limit, double{std::numeric_limits<int>::lowest()},
                                     double{std::numeric_limits<int>::max()}));
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
      if (!info.choices.empty()) option->check(one_of(info.choices));
      if constexpr (std::is_same_v<Value, int>)
        option->check(in_range(whole_limit(info.minimum), whole_limit(info.maximum)));
      else if (std::isfinite(info.minimum) || std::isfinite(info.maximum))
        option->check(in_range(info.minimum, info.maximum));
      else if constexpr (holds_numbers<Value>())
        option->check(finite_number());
      if constexpr (!requires { value.has_value(); }) option->capture_default_str();
    }
  });
}

/// The settings whose flags of add_flags the user gave.
template <class Settings>
std::vector<std::string> given_settings(const CLI::App& command) {
  std::vector<std::string> given;
  const Settings settings;
  Settings::describe(settings, [&](const auto&, const ParameterInfo& info) {
    if (command.count(flag_name(info.name)) > 0) given.push_back(info.name);
  });
  return given;
}

/// --origin, "row,column" in one argument: what follows it is another's. Place: unchanged where the
/// flag is not given.
CLI::Option* add_origin(CLI::App& command, std::vector<int>& place, const std::string& help);

/// Of results that describe themselves, too.
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
