// links: malus_io
#include "malus/io/emva_description.h"

#include <string_view>

#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  (void)malus::parse_emva_description(text, "fuzz.txt", "", false);
}
