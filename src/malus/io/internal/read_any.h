// Any file with a header: the type is told by its first bytes.
#pragma once

#include "malus/io/internal/decoded.h"

#include <filesystem>

namespace malus::internal {

/// Throws InputError. malus' own tags in the description are applied.
Decoded read_any(const std::filesystem::path& path, bool pixels);

}  // namespace malus::internal
