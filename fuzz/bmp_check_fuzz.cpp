// links: malus_io
#include "malus/io/internal/bmp_check.h"

#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  malus::internal::check_bmp(bytes, bytes.size(), "fuzz.bmp");
}
