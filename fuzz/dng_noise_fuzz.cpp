// links: malus_io
#include "malus/io/dng_noise.h"

#include "memory_file.h"
#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  const MemoryFile file(bytes);
  (void)malus::read_dng_noise_profile(file.path());
}
