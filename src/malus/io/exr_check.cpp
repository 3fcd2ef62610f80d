#include "malus/io/internal/exr_check.h"

#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/picture_faults.h"

#include <array>
#include <fstream>
#include <string>

namespace malus::internal {
namespace {

std::uint64_t place_in(std::istream& in) { return static_cast<std::uint64_t>(in.tellg()); }

std::uint32_t number_in(std::istream& in) {
  std::array<std::uint8_t, 4> bytes{};
  in.read(reinterpret_cast<char*>(bytes.data()), bytes.size());
  return load_number<std::uint32_t>(bytes, 0, false);
}

// Whether texts, each behind its length, end where their attribute does.
bool texts_fit(std::istream& in, std::uint64_t end) {
  while (in && place_in(in) < end) {
    const std::uint64_t length = number_in(in);
    if (!in || place_in(in) + length > end) return false;
    in.seekg(static_cast<std::streamoff>(length), std::ios::cur);
  }
  return true;
}

}  // namespace

// Headers are names, types, lengths and values; an empty name ends each, and a second one those of
// a file of several parts.
void check_exr(const std::filesystem::path& path, std::uintmax_t file_bytes) {
  constexpr std::uint32_t kSeveralParts = 0x1000;
  std::ifstream in(path, std::ios::binary);
  in.seekg(4);
  const bool several = (number_in(in) & kSeveralParts) != 0;
  bool after_header = false;
  for (std::string name, type; std::getline(in, name, '\0');) {
    if (name.empty() && (!several || after_header)) return;
    after_header = name.empty();
    if (name.empty()) continue;
    std::getline(in, type, '\0');
    const std::uint64_t length = number_in(in), end = place_in(in) + length;
    if (!in || end > file_bytes || (type == "stringvector" && !texts_fit(in, end)))
      unreadable_picture(path, "it ends inside its header");
    in.seekg(static_cast<std::streamoff>(end));
  }
}

}  // namespace malus::internal
