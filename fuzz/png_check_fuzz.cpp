// links: malus_io
#include "malus/base/error.h"
#include "malus/io/internal/png_check.h"

#include <cstddef>
#include <cstdint>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    malus::internal::check_png({data, size}, "fuzz.png");
  } catch (const malus::InputError&) {  // what bad bytes are meant to give
  }
  return 0;
}
