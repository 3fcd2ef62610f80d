// links: malus_io
#include "malus/io/session.h"

#include <string_view>

#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const malus::Session session = malus::parse_session(text, "fuzz.toml", "", false);
  for (const auto& group : session.groups) (void)malus::frame_options(session, group);
}
