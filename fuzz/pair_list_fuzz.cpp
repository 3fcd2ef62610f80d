// links: malus_io
#include "malus/io/pair_list.h"

#include "memory_file.h"
#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  const MemoryFile file(bytes);
  for (const malus::RecordedPair& pair : malus::load_pair_list(file.path())) (void)pair.scene();
}
