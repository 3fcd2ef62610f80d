#include "malus/io/internal/bmp_check.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cstdlib>
#include <string_view>

#include <fmt/format.h>

namespace malus::internal {
namespace {

[[noreturn]] void damaged_bmp(const std::filesystem::path& path, std::string_view what) {
  throw InputError(path.string(), fmt::format("the BMP file {}", what),
                   "the file is damaged or cut off: copy or record it again");
}

[[noreturn]] void unfit_bmp(const std::filesystem::path& path, std::string_view what) {
  throw InputError(path.string(), fmt::format("the BMP file {}", what),
                   "save it uncompressed with 8 bits per value, or as PNG or TIFF");
}

}  // namespace

// Microsoft, "Bitmap Storage": BITMAPFILEHEADER (14 bytes), then BITMAPINFOHEADER or longer.
BmpShape check_bmp(Bytes bytes, std::uintmax_t file_bytes, const std::filesystem::path& path) {
  if (bytes.size() < kBmpHead) damaged_bmp(path, "ends in its header");
  const std::uintmax_t pixels_at = load_number<std::uint32_t>(bytes, 10, false);
  const auto header_bytes = load_number<std::uint32_t>(bytes, 14, false);
  if (header_bytes < 40 || header_bytes > 124)
    unfit_bmp(path, fmt::format("has a header of {} bytes", header_bytes));
  const std::int64_t cols = load_number<std::int32_t>(bytes, 18, false);
  // Negative where the first row is stored first.
  const std::int64_t stored_rows = load_number<std::int32_t>(bytes, 22, false);
  const std::int64_t rows = std::abs(stored_rows);
  const auto bits = load_number<std::uint16_t>(bytes, 28, false);
  if (bits != 8 && bits != 24 && bits != 32)
    unfit_bmp(path, fmt::format("has {} bits per pixel", bits));
  if (load_number<std::uint32_t>(bytes, 30, false) != 0) unfit_bmp(path, "is compressed");
  check_picture_size(path, rows, cols, bits == 8 ? 1 : bits / 8);
  const auto row_bytes = static_cast<std::uintmax_t>((cols * bits + 31) / 32 * 4);
  const std::uintmax_t needed = pixels_at + row_bytes * static_cast<std::uintmax_t>(rows);
  if (pixels_at < 14 + header_bytes || file_bytes < needed)
    damaged_bmp(path,
                fmt::format("has {} bytes, {}x{} pixels need {}", file_bytes, cols, rows, needed));
  const std::size_t palette_at = 14 + header_bytes;
  const std::size_t room = (static_cast<std::size_t>(pixels_at) - palette_at) / 4;
  const auto declared = load_number<std::uint32_t>(bytes, 46, false);  // 0: all
  const std::size_t colours =
      bits == 8 ? std::min<std::size_t>({room, kBmpColours, declared == 0 ? kBmpColours : declared})
                : 0;
  return {static_cast<std::size_t>(pixels_at),
          static_cast<std::size_t>(row_bytes),
          palette_at,
          colours,
          static_cast<int>(rows),
          static_cast<int>(cols),
          bits,
          stored_rows < 0};
}

}  // namespace malus::internal
