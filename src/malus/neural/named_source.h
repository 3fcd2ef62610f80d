// Settings that lie in a file are refused with the file's name.
#pragma once

#include "malus/base/error.h"

#include <string>

#include <fmt/format.h>

namespace malus {

/// What call returns; an InputError about something else becomes one about source, which holds it.
template <class Call>
decltype(auto) naming_source(const std::string& source, const Call& call) {
  try {
    return call();
  } catch (const InputError& error) {
    if (error.subject() == source) throw;
    throw InputError(source, fmt::format("{}: {}", error.subject(), error.problem()),
                     error.remedy());
  }
}

/// What call returns; an InputError becomes one about a setting of the file, "gains in [noise]", to
/// be told with the file's name by naming_source.
template <class Call>
decltype(auto) naming_key(const std::string& key, const Call& call) {
  try {
    return call();
  } catch (const InputError& error) {
    throw InputError(key, fmt::format("{}: {}", error.subject(), error.problem()), error.remedy());
  }
}

}  // namespace malus
