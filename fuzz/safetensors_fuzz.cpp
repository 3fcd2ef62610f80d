// links: malus_weights
#include "malus/weights/safetensors.h"

#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  (void)malus::parse_tensor_file(std::as_bytes(bytes), "fuzz");
}
