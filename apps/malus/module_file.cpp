#include "module_file.h"

#include "program_start.h"

namespace malus::app {

std::filesystem::path module_file(const char* name) {
  std::error_code error;
  const std::filesystem::path folder = program_start().file.parent_path();
  for (const std::filesystem::path& candidate :
       {folder / name, folder / ".." / MALUS_LIBRARY_FOLDER / "malus" / name})
    if (std::filesystem::exists(candidate, error)) return candidate;
  return {};
}

}  // namespace malus::app
