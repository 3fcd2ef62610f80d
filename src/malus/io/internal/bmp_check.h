// Windows bitmaps before a library opens them: it does not notice what is cut off.
#pragma once

#include "malus/io/internal/file_bytes.h"

#include <filesystem>

namespace malus::internal {

/// `bytes`: the file's head (kBmpHead of them, or all of a shorter file). Throws InputError unless
/// it is an uncompressed bitmap of 8 bits per value (grey or palette, BGR, BGRA) of a valid size
/// whose pixels all lie within `file_bytes`.
void check_bmp(Bytes bytes, std::uintmax_t file_bytes, const std::filesystem::path& path);

inline constexpr std::size_t kBmpHead = 54;  // file header and BITMAPINFOHEADER

}  // namespace malus::internal
