#include "malus/io/internal/tiff_check.h"

#include "malus/base/error.h"
#include "malus/io/internal/file_bytes.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include <fmt/format.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

constexpr std::uint16_t kDescription = 270, kExif = 34665;

[[noreturn]] void cut_tiff(const fs::path& path, std::string_view what) {
  throw InputError(path.string(), fmt::format("the TIFF file ends before its {}", what),
                   "it is damaged or an incomplete copy: copy or record it again");
}

// Bytes of one value by its type's number; 0 of unknown ones.
std::uint64_t bytes_of_type(std::uint16_t type) {
  constexpr std::array<std::uint8_t, 19> kBytes = {0, 1, 1, 2, 4, 8, 1, 1, 2, 4,
                                                   8, 4, 8, 4, 0, 0, 8, 8, 8};
  return type < kBytes.size() ? kBytes[type] : 0;
}

// One file's way of writing numbers, and its size.
struct TiffFile {
  const fs::path& path;
  std::uint64_t file_bytes;
  bool big_endian, big_tiff;

  // A place in the file, or the number of values: 4 bytes, of BigTIFF 8.
  std::uint64_t number(Bytes bytes, std::size_t at) const {
    return big_tiff ? load_number<std::uint64_t>(bytes, at, big_endian)
                    : load_number<std::uint32_t>(bytes, at, big_endian);
  }
  std::uint64_t number_bytes() const { return big_tiff ? 8 : 4; }
  bool within(std::uint64_t at, std::uint64_t bytes) const {
    return at <= file_bytes && bytes <= file_bytes - at;
  }
};

// Throws unless the entry's values are there; where they are more than the entry itself holds, they
// lie elsewhere.
void check_entry(const TiffFile& file, Bytes entry) {
  const auto tag = load_number<std::uint16_t>(entry, 0, file.big_endian);
  const std::uint64_t each = bytes_of_type(load_number<std::uint16_t>(entry, 2, file.big_endian)),
                      count = file.number(entry, 4);
  if (each == 0 || count <= file.number_bytes() / each) return;
  const std::uint64_t at = file.number(entry, static_cast<std::size_t>(4 + file.number_bytes()));
  if (count > file.file_bytes / each || !file.within(at, count * each))
    cut_tiff(file.path, tag == kDescription ? std::string("description")
                                            : fmt::format("values of the tag {}", tag));
}

// The place that the entry tells as its value, which BigTIFF may give in 4 bytes too.
std::uint64_t place_in(const TiffFile& file, Bytes entry) {
  const auto at = static_cast<std::size_t>(4 + file.number_bytes());
  const bool narrow = bytes_of_type(load_number<std::uint16_t>(entry, 2, file.big_endian)) == 4;
  return narrow ? load_number<std::uint32_t>(entry, at, file.big_endian) : file.number(entry, at);
}

// Returns where the Exif directory is, if there is one.
std::optional<std::uint64_t> check_directory(const TiffFile& file, std::uint64_t at,
                                             std::string_view name) {
  const std::uint64_t count_bytes = file.big_tiff ? 8 : 2,
                      entry_bytes = 4 + 2 * file.number_bytes();
  if (!file.within(at, count_bytes)) cut_tiff(file.path, name);
  const auto head = read_part(file.path, at, static_cast<std::size_t>(count_bytes));
  const std::uint64_t entries = file.big_tiff
                                    ? load_number<std::uint64_t>(head, 0, file.big_endian)
                                    : load_number<std::uint16_t>(head, 0, file.big_endian);
  // The place of the next directory is a part of this one.
  if (entries > file.file_bytes / entry_bytes ||
      !file.within(at + count_bytes, entries * entry_bytes + file.number_bytes()))
    cut_tiff(file.path, fmt::format("{}'s end", name));
  const auto bytes =
      read_part(file.path, at + count_bytes, static_cast<std::size_t>(entries * entry_bytes));
  std::optional<std::uint64_t> exif;
  for (std::size_t first = 0; first < bytes.size(); first += entry_bytes) {
    const Bytes entry = Bytes(bytes).subspan(first, static_cast<std::size_t>(entry_bytes));
    check_entry(file, entry);
    if (load_number<std::uint16_t>(entry, 0, file.big_endian) == kExif)
      exif = place_in(file, entry);
  }
  return exif;
}

}  // namespace

void check_tiff(const fs::path& path, std::uintmax_t file_bytes) {
  constexpr std::string_view kName = "directory";
  constexpr std::size_t kPlain = 8, kBig = 16;
  const auto head = read_bytes(path, kBig);
  if (head.size() < kPlain) cut_tiff(path, kName);
  const bool big_endian = head[0] == 'M';
  const bool big_tiff = load_number<std::uint16_t>(head, 2, big_endian) == 43;
  if (big_tiff && head.size() < kBig) cut_tiff(path, kName);
  const TiffFile file{path, file_bytes, big_endian, big_tiff};
  if (const auto exif = check_directory(file, file.number(head, big_tiff ? 8 : 4), kName))
    check_directory(file, *exif, "exposure (Exif)");
}

}  // namespace malus::internal
