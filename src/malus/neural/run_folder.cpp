#include "malus/neural/internal/run_folder.h"

#include "malus/base/error.h"
#include "malus/base/unfinished_files.h"
#include "malus/base/wording.h"
#include "malus/neural/internal/validation.h"

#include <algorithm>
#include <array>
#include <string>
#include <system_error>

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

// The checkpoint first: the run that it is of must not be gone on with if a new one ends early.
constexpr std::array kWeightFiles = {"checkpoint.safetensors", "weights.safetensors",
                                     "best.safetensors"};

// Those that are there: other files in the folder are not the run's.
std::vector<fs::path> samples_in(const fs::path& folder) {
  std::vector<fs::path> found;
  for (const char* name : kSampleNames)
    if (const fs::path path = folder / "sample" / (std::string(name) + ".npy"); fs::exists(path))
      found.push_back(path);
  return found;
}

}  // namespace

RunFolder::RunFolder(const fs::path& folder, bool resume, bool force)
    : path_(folder),
      made_(folder),
      lock_(folder, "training"),
      goes_on_(resume && fs::exists(folder / "checkpoint.safetensors")) {
  remove_unfinished(folder, [](std::string_view name) {
    return name == "log.jsonl" || name.ends_with(".safetensors");
  });
  if (const fs::path checkpoint = file("checkpoint.safetensors");
      !force && !resume && fs::exists(checkpoint))
    throw InputError(checkpoint.string(), "exists already",
                     fmt::format("use {} to go on from it, or {} to train anew",
                                 setting("resume", true), setting("force", true)));
  for (const char* name : kWeightFiles) check_output(file(name), force || goes_on_);
  check_output(file("log.jsonl"), force || resume);
  for (const fs::path& sample : samples_in(folder)) check_output(sample, force || goes_on_);
}

void RunFolder::begin() const {
  for (const char* name : kWeightFiles) fs::remove(file(name));
  for (const fs::path& sample : samples_in(path_)) fs::remove(sample);
  std::error_code holds_others;
  fs::remove(file("sample"), holds_others);
}

bool RunFolder::would_remove(const fs::path& file_to_read) const {
  return std::any_of(kWeightFiles.begin(), kWeightFiles.end(), [&](const char* name) {
    std::error_code absent;
    return fs::equivalent(file(name), file_to_read, absent);
  });
}

}  // namespace malus
