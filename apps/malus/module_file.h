// Parts of the program in files of their own, opened on first need.
#pragma once

#include <filesystem>

namespace malus::app {

/// Beside the program in the build folder; in lib/malus beside bin/ when installed. Empty where
/// there is none.
std::filesystem::path module_file(const char* name);

}  // namespace malus::app
