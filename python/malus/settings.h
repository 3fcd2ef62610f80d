// Settings structs (malus/base/parameter.h) from keyword arguments, results that are described like
// them, and the help text of both.
#pragma once

#include "malus/base/error.h"
#include "malus/base/parameter.h"
#include "malus/base/settings_check.h"
#include "malus/base/text.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <type_traits>
#include <vector>

#include "arrays.h"
#include <fmt/format.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

namespace malus::python {

/// As help texts show it; text bare.
template <class Value>
std::string value_text(const Value& value) {
  if constexpr (requires { value.has_value(); })
    return value ? value_text(*value) : "None";
  else if constexpr (std::is_same_v<Value, bool>)
    return value ? "True" : "False";
  else if constexpr (std::is_same_v<Value, std::vector<double>>)
    return fmt::format("[{}]", fmt::join(value, ", "));
  else
    return fmt::format("{}", value);
}

/// A setting's type, as pybind11 writes those of arguments.
template <class Value>
std::string type_name_of() {
  if constexpr (requires(Value value) { value.has_value(); })
    return "Optional[" + type_name_of<typename Value::value_type>() + "]";
  else if constexpr (std::is_same_v<Value, std::vector<double>>)
    return "List[float]";
  else if constexpr (std::is_same_v<Value, std::string>)
    return "str";
  else if constexpr (std::is_same_v<Value, bool>)
    return "bool";
  else
    return std::is_integral_v<Value> ? "int" : "float";
}

/// Throws TypeError that says what is given and what is wanted, as of other arguments.
template <class Value>
Value setting_from(const pybind11::object& given, const std::string& name) {
  namespace py = pybind11;
  try {
    if constexpr (std::is_same_v<Value, std::vector<double>>)
      return given.cast<Numbers>().values;
    else
      return given.cast<Value>();
  } catch (const py::cast_error&) {
    const py::object line =
        py::module_::import("malus._arguments").attr("refused")(name, given, type_name_of<Value>());
    PyErr_SetObject(PyExc_TypeError, line.ptr());
    throw py::error_already_set();
  }
}

/// Throws InputError for a value outside its range or choices, TypeError for a wrong type or an
/// unknown name (with the nearest).
template <class Settings>
Settings settings_from(const pybind11::kwargs& kwargs) {
  namespace py = pybind11;
  Settings settings;
  std::vector<std::string> known;
  Settings::describe(settings, [&](auto& value, const ParameterInfo& info) {
    using Value = std::decay_t<decltype(value)>;
    known.push_back(info.name);
    if (!kwargs.contains(info.name.c_str())) return;
    value = setting_from<Value>(kwargs[info.name.c_str()], info.name);
    require_setting(value, info);
  });
  for (const auto& [key, unused] : kwargs) {
    const auto name = key.template cast<std::string>();
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw py::type_error(fmt::format("unknown keyword argument {}; {}known: {}", name,
                                       did_you_mean(name, known), joined(known)));
  }
  return settings;
}

/// Every value in turn, in full precision: equal for equal settings alone.
template <class Settings>
std::vector<std::string> values_of(const Settings& settings) {
  std::vector<std::string> values;
  Settings::describe(settings, [&](const auto& value, const ParameterInfo&) {
    values.push_back(value_text(value));
  });
  return values;
}

/// The settings among them that the caller gave.
template <class Settings>
std::vector<std::string> given_settings(const pybind11::kwargs& kwargs) {
  std::vector<std::string> given;
  const Settings settings;
  Settings::describe(settings, [&](const auto&, const ParameterInfo& info) {
    if (kwargs.contains(info.name.c_str())) given.push_back(info.name);
  });
  return given;
}

/// A result that describes itself.
template <class Result>
pybind11::dict dict_of_described(const Result& result) {
  pybind11::dict out;
  Result::describe(result, [&](const auto& value, const ParameterInfo& info) {
    out[info.name.c_str()] = value;
  });
  return out;
}

/// One line per value of such a result: name, unit, meaning.
template <class Result>
std::string results_help() {
  std::string text;
  const Result result;
  Result::describe(result, [&](const auto&, const ParameterInfo& info) {
    text += "    " + info.name;
    if (!info.unit.empty() && info.unit != "1") text += " [" + info.unit + "]";
    text += ": " + info.help + "\n";
  });
  return text;
}

/// One line per setting: name, default, unit, meaning.
template <class Settings>
std::string settings_help() {
  std::string text = "\n\nFurther keyword arguments:\n";
  const Settings settings;
  Settings::describe(settings, [&](const auto& value, const ParameterInfo& info) {
    std::string shown = value_text(value);
    if constexpr (std::is_same_v<std::decay_t<decltype(value)>, std::string>)
      shown = "'" + shown + "'";
    text += fmt::format("    {} = {}", info.name, shown);
    if (!info.unit.empty() && info.unit != "1") text += fmt::format(" [{}]", info.unit);
    text += ": " + info.help;
    if (!info.choices.empty()) text += " (" + joined(info.choices) + ")";
    text += "\n";
  });
  return text;
}

}  // namespace malus::python
