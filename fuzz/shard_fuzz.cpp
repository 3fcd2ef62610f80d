// links: malus_io
#include "malus/io/shard_read.h"

#include "memory_file.h"
#include "target.h"

// Every entry, as training reads samples.
void parse_bytes(std::span<const std::uint8_t> bytes) {
  const MemoryFile file(bytes);
  for (const malus::ShardEntry& entry : malus::shard_entries(file.path()))
    (void)malus::planes_of_npy(malus::shard_content(file.path(), entry), entry.name);
}
