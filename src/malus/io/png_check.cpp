#include "malus/io/internal/png_check.h"

#include "malus/base/error.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <string>

#include <fmt/format.h>
#include <zlib.h>

namespace malus::internal {
namespace {

[[noreturn]] void damaged_png(const std::filesystem::path& path, std::string_view what) {
  throw InputError(path.string(), fmt::format("the PNG file {}", what),
                   "the file is damaged or cut off: copy or record it again");
}

// The first chunk's.
void check_header(Bytes bytes, std::size_t at, std::size_t length,
                  const std::filesystem::path& path) {
  constexpr std::size_t kHeader = 13;
  constexpr std::uint32_t kMaxSide = 0x7fffffff;
  if (length != kHeader) damaged_png(path, "has an IHDR chunk of another length than 13");
  const auto cols = load_number<std::uint32_t>(bytes, at, true);
  const auto rows = load_number<std::uint32_t>(bytes, at + 4, true);
  if (cols < 1 || rows < 1 || cols > kMaxSide || rows > kMaxSide)
    damaged_png(path, fmt::format("declares {}x{} pixels", cols, rows));
  check_picture_size(path, rows, cols, 1);
}

}  // namespace

void check_png(Bytes bytes, const std::filesystem::path& path) {
  constexpr std::array<std::uint8_t, 8> kSignature = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  if (bytes.size() < kSignature.size() ||
      !std::equal(kSignature.begin(), kSignature.end(), bytes.begin()))
    damaged_png(path, "has a damaged signature");
  constexpr std::size_t kFrame = 12;  // length, type, checksum
  std::size_t at = kSignature.size();
  bool first = true, has_pixels = false;
  while (true) {
    if (bytes.size() - at < kFrame) damaged_png(path, "ends before its IEND chunk");
    const std::size_t length = load_number<std::uint32_t>(bytes, at, true);
    const std::string type(reinterpret_cast<const char*>(bytes.data()) + at + 4, 4);
    if (!std::all_of(type.begin(), type.end(),
                     [](unsigned char c) { return c < 0x80 && std::isalpha(c) != 0; }))
      damaged_png(path, "has a chunk of no valid type");
    if (length > bytes.size() - at - kFrame)
      damaged_png(path, fmt::format("ends inside its {} chunk", type));
    const std::uint32_t stored = load_number<std::uint32_t>(bytes, at + 8 + length, true);
    if (crc32_z(0, bytes.data() + at + 4, 4 + length) != stored)
      damaged_png(path, fmt::format("has a wrong checksum in its {} chunk", type));
    if (first != (type == "IHDR")) damaged_png(path, "does not begin with one IHDR chunk");
    if (first) check_header(bytes, at + 8, length, path);
    first = false;
    has_pixels = has_pixels || type == "IDAT";
    if (type == "IEND") break;
    at += kFrame + length;
  }
  if (!has_pixels) damaged_png(path, "has no pixels (no IDAT chunk)");
}

}  // namespace malus::internal
