#include "module_file.h"

#include <dlfcn.h>
#include <fmt/format.h>

namespace malus::app {

std::filesystem::path module_file(const char* name) {
  std::error_code error;
  for (const std::filesystem::path& folder : module_opener().folders)
    if (std::filesystem::exists(folder / name, error)) return folder / name;
  return {};
}

OpenModule open_module(const std::filesystem::path& path, const char* entry,
                       const std::string& advice) {
  void* const handle = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (handle == nullptr)
    throw InputError(path.string(), fmt::format("cannot be loaded ({})", dlerror()), advice);
  return {handle, dlsym(handle, entry)};
}

InputError other_version(const std::filesystem::path& path) {
  return InputError(path.string(), "is of another version than " + module_opener().name,
                    "build both again");
}

}  // namespace malus::app
