// links: malus_weights
#include "malus/weights/torch_archive.h"

#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  // Every value that a view promises is read. Checksums would stop every change at the door.
  static volatile unsigned sum = 0;
  for (const malus::ArchivedTensor& tensor :
       malus::parse_torch_archive(std::as_bytes(bytes), "fuzz", false))
    for (const std::byte value : tensor.values) sum = sum + std::to_integer<unsigned>(value);
}
