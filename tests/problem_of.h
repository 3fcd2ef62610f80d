// What a call is refused with.
#pragma once

#include "malus/base/error.h"

#include <functional>
#include <string>

namespace malus::testing {

/// The InputError's line; empty where nothing was refused.
inline std::string problem_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace malus::testing
