// links: malus_io
#include "malus/io/internal/png_check.h"

#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  malus::internal::check_png(bytes, "fuzz.png");
}
