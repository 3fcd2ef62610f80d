// links: malus_io
#include "malus/io/internal/jpeg_check.h"

#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  malus::internal::check_jpeg(bytes, "fuzz.jpg");
}
