// The head of Windows bitmaps.
#pragma once

#include "malus/io/internal/file_bytes.h"

#include <filesystem>

namespace malus::internal {

/// Where the pixels lie: rows of whole four bytes, the last first unless `from_top`.
struct BmpShape {
  std::size_t pixels_at, row_bytes;
  std::size_t palette_at, colours;  ///< of four bytes each: blue, green, red and one of no use
  int rows, cols, bits;
  bool from_top;
};

/// `bytes`: the file's head (kBmpHead of them, or all of a shorter file). Throws InputError unless
/// it is an uncompressed bitmap of 8 bits per value (grey or palette, BGR, BGRA) of a valid size
/// whose pixels all lie within `file_bytes`.
BmpShape check_bmp(Bytes bytes, std::uintmax_t file_bytes, const std::filesystem::path& path);

inline constexpr std::size_t kBmpHead = 54;  // file header and BITMAPINFOHEADER
inline constexpr std::size_t kBmpColours = 256;

}  // namespace malus::internal
