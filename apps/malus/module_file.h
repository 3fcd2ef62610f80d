// Parts of the program in files of their own, opened on first need.
#pragma once

#include "malus/base/error.h"

#include <filesystem>
#include <string>

namespace malus::app {

/// Beside the program in the build folder; in lib/malus beside bin/ when installed. Empty where
/// there is none.
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
