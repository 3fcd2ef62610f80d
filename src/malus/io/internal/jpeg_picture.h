// JPEG through libjpeg-turbo: clean material alone, since nothing that is measured is read from it.
#pragma once

#include "malus/io/internal/decoded.h"

#include <filesystem>

namespace malus::internal {

/// Grey or RGB. Throws InputError when damaged or cut off.
Decoded read_jpeg(const std::filesystem::path& path, std::uintmax_t file_bytes);

}  // namespace malus::internal
