// links: malus_io
#include "malus/base/error.h"
#include "malus/io/internal/npy.h"

#include <cstddef>
#include <cstdint>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    (void)malus::internal::parse_npy({data, size}, "fuzz.npy");
  } catch (const malus::InputError&) {  // what bad bytes are meant to give
  }
  return 0;
}
