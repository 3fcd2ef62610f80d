// links: malus_io
#include "malus/io/internal/netpbm.h"

#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  (void)malus::internal::parse_netpbm(bytes, "fuzz.pgm");
}
