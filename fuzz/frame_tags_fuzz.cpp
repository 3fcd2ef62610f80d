// links: malus_io
#include "malus/io/internal/frame_tags.h"

#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  malus::internal::Decoded decoded;
  decoded.description.assign(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  malus::internal::apply_frame_tags(decoded);
}
