// Apart from what decodes them: telling a file's type needs no library.
#include "malus/base/text.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/picture_codec.h"

#include <algorithm>
#include <cstdint>
#include <initializer_list>

namespace malus::internal {

std::string picture_codec(const std::filesystem::path& path) {
  const auto head = read_bytes(path, 8);
  const auto begins = [&](std::initializer_list<std::uint8_t> magic) {
    return head.size() >= magic.size() && std::equal(magic.begin(), magic.end(), head.begin());
  };
  if (begins({0x89, 'P', 'N', 'G'})) return "png";
  if (begins({0x76, 0x2f, 0x31, 0x01})) return "openexr";
  if (begins({'B', 'M'})) return "bmp";
  const std::string ending = lower_case(path.extension().string());
  if (ending != ".tif" && ending != ".tiff") return {};
  if (begins({'I', 'I', 42, 0}) || begins({'M', 'M', 0, 42}) || begins({'I', 'I', 43, 0}) ||
      begins({'M', 'M', 0, 43}))
    return "tiff";
  return {};
}

}  // namespace malus::internal
