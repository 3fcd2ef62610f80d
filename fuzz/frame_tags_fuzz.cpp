// links: malus_io
#include "malus/base/error.h"
#include "malus/io/internal/frame_tags.h"

#include <cstddef>
#include <cstdint>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    malus::internal::Decoded decoded;
    decoded.description.assign(reinterpret_cast<const char*>(data), size);
    malus::internal::apply_frame_tags(decoded);
  } catch (const malus::InputError&) {  // what bad bytes are meant to give
  }
  return 0;
}
