#include "malus/io/internal/bmp_picture.h"

#include "malus/base/error.h"
#include "malus/io/internal/bmp_check.h"
#include "malus/io/internal/picture_faults.h"

#include <algorithm>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kColourBytes = 4;
// Of red, green, blue and alpha within a stored colour.
constexpr std::size_t kPlaceOf[] = {2, 1, 0, 3};

bool is_grey(Bytes palette) {
  for (std::size_t at = 0; at < palette.size(); at += kColourBytes)
    if (palette[at] != palette[at + 1] || palette[at] != palette[at + 2]) return false;
  return true;
}

void take_bmp_row(Bytes row, const BmpShape& shape, Bytes palette, int r, Planes& planes) {
  const auto stored = static_cast<std::size_t>(shape.bits / 8);
  for (int c = 0; c < planes.cols(); ++c) {
    Bytes colour = row.subspan(static_cast<std::size_t>(c) * stored, stored);
    if (shape.bits == 8) colour = palette.subspan(colour[0] * kColourBytes, kColourBytes);
    for (int k = 0; k < planes.channels(); ++k) planes[k](r, c) = colour[kPlaceOf[k]];
  }
}

// A pixel's number lies within the palette.
void check_numbers(const fs::path& path, Bytes row, const BmpShape& shape) {
  const Bytes numbers = row.first(static_cast<std::size_t>(shape.cols));
  if (*std::max_element(numbers.begin(), numbers.end()) >= shape.colours)
    unreadable_picture(path, "a pixel has a colour that is not in its palette");
}

}  // namespace

Decoded read_bmp(const fs::path& path, std::uintmax_t file_bytes, bool pixels) {
  const BmpShape shape = check_bmp(read_bytes(path, kBmpHead), file_bytes, path);
  const auto palette = read_part(path, shape.palette_at, shape.colours * kColourBytes);
  Decoded decoded;
  decoded.format = "bmp";
  decoded.sample = "uint8";
  decoded.bits = 8;
  decoded.rows = shape.rows;
  decoded.cols = shape.cols;
  decoded.channels = shape.bits == 32 ? 4 : shape.bits == 24 || !is_grey(palette) ? 3 : 1;
  if (!pixels) return decoded;
  decoded.planes = Planes(decoded.channels, decoded.rows, decoded.cols);
  const auto bytes = read_bytes(path);
  for (int i = 0; i < shape.rows; ++i) {
    const Bytes row = Bytes(bytes).subspan(
        shape.pixels_at + static_cast<std::size_t>(i) * shape.row_bytes, shape.row_bytes);
    if (shape.bits == 8) check_numbers(path, row, shape);
    take_bmp_row(row, shape, palette, shape.from_top ? i : shape.rows - 1 - i, decoded.planes);
  }
  return decoded;
}

}  // namespace malus::internal
