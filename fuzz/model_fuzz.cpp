// links: malus_noise
// The model file: whatever the bytes, load_model returns a consistent model or throws InputError.
#include "malus/base/error.h"
#include "malus/noise/model.h"

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>

#include <sys/mman.h>
#include <unistd.h>

// The leak sanitizer asks for this: on damaged files HDF5 itself loses some memory.
extern "C" const char* __lsan_default_suppressions() {  // NOLINT: the sanitizer's name
  return "leak:libhdf5";
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const int file = memfd_create("model", MFD_CLOEXEC);
  if (file < 0) std::abort();
  if (write(file, data, size) != static_cast<ssize_t>(size)) std::abort();
  try {
    const malus::NoiseModel model = malus::load_model("/proc/self/fd/" + std::to_string(file));
    if (!malus::contradiction_in(model).empty()) std::abort();
  } catch (const malus::InputError&) {
  }
  close(file);
  return 0;
}
