// links: malus_weights
#include "malus/weights/internal/pickle.h"

#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  (void)malus::parse_pickle(std::as_bytes(bytes), "fuzz");
}
