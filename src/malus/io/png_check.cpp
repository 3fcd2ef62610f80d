#include "malus/io/internal/png_check.h"

#include "malus/base/error.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <string>

#include <fmt/format.h>

namespace malus::internal {
namespace {

// Eight tables take eight bytes per step (Kounavis and Berry, "Novel table lookup-based algorithms
// for high-performance CRC generation", 2008): the check must not slow down decoding.
using CrcTables = std::array<std::array<std::uint32_t, 256>, 8>;

const CrcTables& crc_tables() {
  static const CrcTables tables = [] {
    CrcTables t{};
    for (std::uint32_t i = 0; i < 256; ++i) {
      std::uint32_t crc = i;
      for (int bit = 0; bit < 8; ++bit) crc = crc & 1 ? 0xEDB88320u ^ (crc >> 1) : crc >> 1;
      t[0][i] = crc;
    }
    for (std::size_t k = 1; k < t.size(); ++k)
      for (std::size_t i = 0; i < 256; ++i) t[k][i] = (t[k - 1][i] >> 8) ^ t[0][t[k - 1][i] & 0xff];
    return t;
  }();
  return tables;
}

[[noreturn]] void damaged_png(const std::filesystem::path& path, std::string_view what) {
  throw InputError(path.string(), fmt::format("the PNG file {}", what),
                   "the file is damaged or cut off: copy or record it again");
}

}  // namespace

std::uint32_t crc32(Bytes bytes) {
  const CrcTables& t = crc_tables();
  std::uint32_t crc = 0xffffffffu;
  std::size_t i = 0;
  for (; i + 8 <= bytes.size(); i += 8) {
    const std::uint32_t low = crc ^ load_number<std::uint32_t>(bytes, i, false);
    const std::uint32_t high = load_number<std::uint32_t>(bytes, i + 4, false);
    crc = t[7][low & 0xff] ^ t[6][low >> 8 & 0xff] ^ t[5][low >> 16 & 0xff] ^ t[4][low >> 24] ^
          t[3][high & 0xff] ^ t[2][high >> 8 & 0xff] ^ t[1][high >> 16 & 0xff] ^ t[0][high >> 24];
  }
  for (; i < bytes.size(); ++i) crc = (crc >> 8) ^ t[0][(crc ^ bytes[i]) & 0xff];
  return ~crc;
}

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
    if (crc32(bytes.subspan(at + 4, 4 + length)) != stored)
      damaged_png(path, fmt::format("has a wrong checksum in its {} chunk", type));
    if (first != (type == "IHDR")) damaged_png(path, "does not begin with one IHDR chunk");
    first = false;
    has_pixels = has_pixels || type == "IDAT";
    if (type == "IEND") break;
    at += kFrame + length;
  }
  if (!has_pixels) damaged_png(path, "has no pixels (no IDAT chunk)");
}

}  // namespace malus::internal
