// links: malus_io
#include "malus/base/error.h"
#include "malus/io/session.h"

#include <cstddef>
#include <cstdint>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const std::string_view text(reinterpret_cast<const char*>(data), size);
    const malus::Session session = malus::parse_session(text, "fuzz.toml", "", false);
    for (const auto& group : session.groups) (void)malus::frame_options(session, group);
  } catch (const malus::InputError&) {  // what bad bytes are meant to give
  }
  return 0;
}
