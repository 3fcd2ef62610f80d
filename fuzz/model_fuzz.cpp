// links: malus_noise
// The model file: whatever the bytes, load_model returns a consistent model or throws InputError,
// and what a denoiser takes from a consistent one lies inside the sensor.
// Under libFuzzer Debian 12's HDF5 (1.10.8) itself reads out of bounds on damaged files of the old
// format, which has no checksums (good_h5py.h5 is one); files that malus writes have them. Findings
// whose top frames lie in libhdf5 are not ours.
#include "malus/base/error.h"
#include "malus/noise/fixed_pattern.h"
#include "malus/noise/model.h"
#include "malus/noise/profile.h"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "target.h"
#include <unistd.h>

// The leak sanitizer asks for this: on damaged files HDF5 itself loses some memory.
extern "C" const char* __lsan_default_suppressions() {  // NOLINT: the sanitizer's name
  return "leak:libhdf5";
}

// HDF5 asks for what a damaged file claims, and takes no for an answer.
extern "C" const char* __asan_default_options() {  // NOLINT: the sanitizer's name
  return "allocator_may_return_null=1";
}

namespace {

// A file with a name: HDF5 refuses the names of memory files (/proc/self/fd). In memory where the
// machine has such a folder.
struct ScratchFile {
  std::filesystem::path path = [] {
    const std::filesystem::path memory = "/dev/shm";
    return (std::filesystem::is_directory(memory) ? memory
                                                  : std::filesystem::temp_directory_path()) /
           ("malus-model-fuzz-" + std::to_string(getpid()) + ".h5");
  }();
  ~ScratchFile() { std::filesystem::remove(path); }
};

// What a denoiser takes from the model; a defect outside its list's frame would be written to.
void use_at(const malus::NoiseModel& model, const malus::GainSetting& gain) {
  (void)malus::fixed_pattern_at(model, gain);
  try {
    malus::NoiseProfile profile = model.profile_at(gain);
    const malus::DefectList& defects = profile.defects;
    for (const auto& place : defects.places)
      if (place.row < 0 || place.col < 0 || place.row >= defects.rows || place.col >= defects.cols)
        std::abort();
    add_pattern_noise(profile, pattern_deviations_at(model, gain, profile));
  } catch (const malus::InputError&) {  // no K, or not a gain of the kind that goes first
  }
}

}  // namespace

void parse_bytes(std::span<const std::uint8_t> bytes) {
  static const ScratchFile file;
  std::ofstream(file.path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  const malus::NoiseModel model = malus::load_model(file.path);
  if (!malus::contradiction_in(model).empty()) std::abort();
  for (const auto& physics : model.physics) use_at(model, physics.gain);
  for (const auto& gaussian : model.gaussian) use_at(model, gaussian.gain);
  for (const auto& levels : model.nonparametric) use_at(model, levels.gain);
}
