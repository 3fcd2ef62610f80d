// What is said of a file that does not open: the same everywhere, and whichever is true of it.
#pragma once

#include "malus/base/error.h"

#include <filesystem>

namespace malus {

/// Whether it opens for reading; errno tells why not.
bool can_be_opened(const std::filesystem::path& path);

/// To be thrown where `path` could not be opened or read: it is missing, a folder, or may not be
/// read.
InputError unreadable_file(const std::filesystem::path& path);

}  // namespace malus
