// Parts of the program and of the Python module in files of their own, opened on first need.
#pragma once

#include "malus/base/error.h"
#include "malus/base/wording.h"

#include <filesystem>
#include <string>
#include <vector>

namespace malus::app {

/// Who opens them.
struct ModuleOpener {
  std::string name;                            ///< within messages: "the program"
  std::vector<std::filesystem::path> folders;  ///< where its modules may lie, the first wins
  const Wording& wording;                      ///< of the messages that they make
};

/// Each opener defines it.
const ModuleOpener& module_opener();

/// Empty where there is none.
std::filesystem::path module_file(const char* name);

struct OpenModule {
  void* handle;  ///< of dlopen
  void* entry;   ///< the named symbol; null where it has none
};

/// Throws InputError with this advice where it cannot be loaded.
OpenModule open_module(const std::filesystem::path& path, const char* entry,
                       const std::string& advice);

/// What is said of a module without its entry, or of another kModulesInterface.
InputError other_version(const std::filesystem::path& path);

}  // namespace malus::app
