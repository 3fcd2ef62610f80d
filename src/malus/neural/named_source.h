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

}  // namespace malus
