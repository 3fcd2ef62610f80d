// links: malus_neural
#include "malus/base/error.h"
#include "malus/neural/safetensors.h"

#include <cstddef>
#include <cstdint>
#include <span>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    (void)malus::parse_tensor_file(std::as_bytes(std::span(data, size)), "fuzz");
  } catch (const malus::InputError&) {  // what bad bytes are meant to give
  }
  return 0;
}
