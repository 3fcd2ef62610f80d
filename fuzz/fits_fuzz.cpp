// links: malus_io
#include "malus/base/error.h"
#include "malus/io/internal/fits.h"

#include <cstddef>
#include <cstdint>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    (void)malus::internal::parse_fits({data, size}, "fuzz.fits");
  } catch (const malus::InputError&) {  // what bad bytes are meant to give
  }
  return 0;
}
