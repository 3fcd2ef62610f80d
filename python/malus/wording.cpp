#include "wording.h"

#include <array>
#include <string>
#include <string_view>
#include <utility>

#include <fmt/format.h>

namespace malus::python {
namespace {

using Names = std::pair<std::string_view, std::string_view>;

// Settings that have another name here: a gain is in its model's unit.
constexpr std::array<Names, 2> kKeywords{{{"iso", "gain"}, {"uncertainty", "variance"}}};
constexpr std::array<Names, 2> kFunctions{
    {{"model list", "malus.models()"}, {"model show", "Model.as_dict()"}}};

std::string keyword_name(std::string_view name) {
  for (const auto& [setting, keyword] : kKeywords)
    if (setting == name) return std::string(keyword);
  return std::string(name);
}

std::string keyword(std::string_view setting, const SettingValue& value) {
  const std::string name = keyword_name(setting);
  if (const auto* on = std::get_if<bool>(&value)) return name + (*on ? "=True" : "=False");
  if (const auto* number = std::get_if<double>(&value)) return name + "=" + number_text(*number);
  if (const auto* text = std::get_if<std::string_view>(&value))
    return fmt::format("{}=\"{}\"", name, *text);
  return name + "=";
}

std::string function(std::string_view words) {
  for (const auto& [command, name] : kFunctions)
    if (command == words) return std::string(name);
  return fmt::format("`malus {}`", words);
}

}  // namespace

constexpr Wording kKeywordWording{keyword, keyword_name, function};

void use_python_wording(pybind11::module_& m) {
  use_wording(kKeywordWording);
  pybind11::dict keywords;
  for (const auto& [setting, keyword] : kKeywords)
    keywords[pybind11::str(setting.data(), setting.size())] =
        pybind11::str(keyword.data(), keyword.size());
  m.attr("_keywords") = keywords;
}

}  // namespace malus::python
