// libFuzzer's entry to a target.
#include "malus/base/error.h"

#include "target.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    parse_bytes({data, size});
  } catch (const malus::InputError&) {  // what bad bytes are meant to give
  }
  return 0;
}
