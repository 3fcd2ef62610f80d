// Uncompressed Windows bitmaps (Microsoft, "Bitmap Storage").
#pragma once

#include "malus/io/internal/decoded.h"

#include <cstdint>
#include <filesystem>

namespace malus::internal {

/// One channel where there is a palette of greys, RGB of other palettes and of 24 bits, RGBA of 32.
/// Throws InputError as check_bmp, and where a pixel's colour is not in the palette.
Decoded read_bmp(const std::filesystem::path& path, std::uintmax_t file_bytes, bool pixels);

}  // namespace malus::internal
