#include "malus/neural/failures.h"

#include "malus/base/error.h"

#include <new>
#include <string>

#include <c10/util/Exception.h>
#include <fmt/format.h>

namespace malus {

void rethrow_libtorch_failure(const char* remedy) {
  try {
    throw;
  } catch (const c10::Error& error) {
    const std::string text = error.what_without_backtrace();
    for (const char* shortage : {"can't allocate memory", "not enough memory", "out of memory"})
      if (text.find(shortage) != text.npos) throw std::bad_alloc();
    throw InputError("libtorch", fmt::format("failed ({})", text.substr(0, text.find('\n'))),
                     remedy);
  }
}

}  // namespace malus
