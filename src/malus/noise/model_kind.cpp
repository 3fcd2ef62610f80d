#include "malus/noise/model_kind.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"

#include <algorithm>

#include <fmt/format.h>

namespace malus {

std::vector<std::string> model_kind_names() {
  return {kModelKindNames.begin(), kModelKindNames.end()};
}

std::vector<std::string> model_kind_names(const std::vector<ModelKind>& kinds) {
  std::vector<std::string> names;
  for (const ModelKind kind : kinds) names.emplace_back(model_kind_name(kind));
  return names;
}

ModelKind model_kind(std::string_view name) {
  const auto found = std::ranges::find(kModelKindNames, name);
  if (found == kModelKindNames.end())
    throw InputError(setting_name("kinds"), fmt::format("{} is not a kind of model", name),
                     "choose of " + joined(model_kind_names()));
  return static_cast<ModelKind>(found - kModelKindNames.begin());
}

std::vector<ModelKind> model_kinds(const std::vector<std::string>& names) {
  std::vector<ModelKind> kinds;
  for (const std::string& name : names) kinds.push_back(model_kind(name));
  return kinds;
}

}  // namespace malus
