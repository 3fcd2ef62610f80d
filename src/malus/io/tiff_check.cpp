#include "malus/io/internal/tiff_check.h"

#include "malus/base/error.h"
#include "malus/io/internal/tiff_file.h"

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
constexpr std::string_view kDirectory = "directory";

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

// Throws unless the entry's values are there; where they are more than the entry itself holds, they
// lie elsewhere.
void check_entry(const TiffFile& file, Bytes entry) {
  const std::uint64_t each = bytes_of_type(file.type(entry)), count = file.number(entry, 4);
  if (each == 0 || count <= file.number_bytes() / each) return;
  const std::uint64_t at = file.number(entry, static_cast<std::size_t>(4 + file.number_bytes()));
  if (count > file.file_bytes / each || !file.within(at, count * each))
    cut_tiff(file.path, file.tag(entry) == kDescription
                            ? std::string("description")
                            : fmt::format("values of the tag {}", file.tag(entry)));
}

// The place that the entry tells as its value, which BigTIFF may give in 4 bytes too.
std::uint64_t place_in(const TiffFile& file, Bytes entry) {
  const auto at = static_cast<std::size_t>(4 + file.number_bytes());
  const bool narrow = bytes_of_type(file.type(entry)) == 4;
  return narrow ? load_number<std::uint32_t>(entry, at, file.big_endian) : file.number(entry, at);
}

// Returns where the Exif directory is, if there is one.
std::optional<std::uint64_t> check_directory(const TiffFile& file, std::uint64_t at,
                                             std::string_view name) {
  const auto bytes = tiff_entries(file, at, name);
  std::optional<std::uint64_t> exif;
  for (std::size_t first = 0; first < bytes.size(); first += file.entry_bytes()) {
    const Bytes entry = Bytes(bytes).subspan(first, file.entry_bytes());
    check_entry(file, entry);
    if (file.tag(entry) == kExif) exif = place_in(file, entry);
  }
  return exif;
}

}  // namespace

TiffFile tiff_file(const fs::path& path, std::uintmax_t file_bytes) {
  constexpr std::size_t kPlain = 8, kBig = 16;
  const auto head = read_bytes(path, kBig);
  if (head.size() < kPlain) cut_tiff(path, kDirectory);
  const bool big_endian = head[0] == 'M';
  const bool big_tiff = load_number<std::uint16_t>(head, 2, big_endian) == 43;
  if (big_tiff && head.size() < kBig) cut_tiff(path, kDirectory);
  TiffFile file{path, file_bytes, big_endian, big_tiff, 0};
  file.first_directory = file.number(head, big_tiff ? 8 : 4);
  return file;
}

std::vector<std::uint8_t> tiff_entries(const TiffFile& file, std::uint64_t at,
                                       std::string_view name) {
  const std::uint64_t count_bytes = file.big_tiff ? 8 : 2, entry_bytes = file.entry_bytes();
  if (!file.within(at, count_bytes)) cut_tiff(file.path, name);
  const auto head = read_part(file.path, at, static_cast<std::size_t>(count_bytes));
  const std::uint64_t entries = file.big_tiff
                                    ? load_number<std::uint64_t>(head, 0, file.big_endian)
                                    : load_number<std::uint16_t>(head, 0, file.big_endian);
  // The place of the next directory is a part of this one.
  if (entries > file.file_bytes / entry_bytes ||
      !file.within(at + count_bytes, entries * entry_bytes + file.number_bytes()))
    cut_tiff(file.path, fmt::format("{}'s end", name));
  return read_part(file.path, at + count_bytes, static_cast<std::size_t>(entries * entry_bytes));
}

std::vector<std::uint64_t> tiff_values(const TiffFile& file, Bytes entry, std::uint64_t most) {
  constexpr std::array<std::uint16_t, 4> kWhole = {1, 3, 4, 16};
  const std::uint16_t type = file.type(entry);
  if (std::find(kWhole.begin(), kWhole.end(), type) == kWhole.end()) return {};
  const auto each = static_cast<std::size_t>(bytes_of_type(type));
  const std::uint64_t held = file.number(entry, 4);
  const auto count = static_cast<std::size_t>(std::min(held, most));
  const auto values_at = static_cast<std::size_t>(4 + file.number_bytes());
  std::vector<std::uint8_t> bytes;
  if (held <= file.number_bytes() / each) {
    const Bytes inside = entry.subspan(values_at, count * each);
    bytes.assign(inside.begin(), inside.end());
  } else {
    const std::uint64_t at = file.number(entry, values_at);
    if (count > file.file_bytes / each || !file.within(at, count * each)) return {};
    bytes = read_part(file.path, at, count * each);
  }
  std::vector<std::uint64_t> values;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t at = i * each;
    values.push_back(each == 1   ? bytes[at]
                     : each == 2 ? load_number<std::uint16_t>(bytes, at, file.big_endian)
                     : each == 4 ? load_number<std::uint32_t>(bytes, at, file.big_endian)
                                 : load_number<std::uint64_t>(bytes, at, file.big_endian));
  }
  return values;
}

void check_tiff(const fs::path& path, std::uintmax_t file_bytes) {
  const TiffFile file = tiff_file(path, file_bytes);
  if (const auto exif = check_directory(file, file.first_directory, kDirectory))
    check_directory(file, *exif, "exposure (Exif)");
}

}  // namespace malus::internal
