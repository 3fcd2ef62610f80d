// links: malus_io
#include "malus/base/error.h"
#include "malus/io/emva_description.h"

#include <cstddef>
#include <cstdint>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const std::string_view text(reinterpret_cast<const char*>(data), size);
    (void)malus::parse_emva_description(text, "fuzz.txt", "", false);
  } catch (const malus::InputError&) {  // what bad bytes are meant to give
  }
  return 0;
}
