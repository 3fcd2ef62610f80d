// links: malus_io
#include "malus/io/internal/camera_raw.h"

#include "memory_file.h"
#include "target.h"

// What LibRaw makes of a file is LibRaw's affair; what we make of LibRaw's sizes, levels and
// patterns is ours.
void parse_bytes(std::span<const std::uint8_t> bytes) {
  const MemoryFile file(bytes);
  (void)malus::internal::read_camera_raw(file.path(), true);
}
