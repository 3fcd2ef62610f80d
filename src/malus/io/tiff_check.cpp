#include "malus/io/internal/tiff_check.h"

#include "malus/io/internal/tiff_file.h"

#include <optional>
#include <string>
#include <vector>

#include <fmt/format.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

// Throws unless the entry's values are there; where they are more than the entry itself holds, they
// lie elsewhere.
void check_entry(const TiffFile& file, Bytes entry) {
  const std::uint64_t each = bytes_of_tiff_type(file.type(entry)), count = file.number(entry, 4);
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
  const bool narrow = bytes_of_tiff_type(file.type(entry)) == 4;
  return narrow ? load_number<std::uint32_t>(entry, at, file.big_endian) : file.number(entry, at);
}

// Returns where the Exif directory is, if there is one.
std::optional<std::uint64_t> check_directory(const TiffFile& file, std::uint64_t at,
                                             std::string_view name) {
  const auto bytes = tiff_entries(file, at, name).bytes;
  std::optional<std::uint64_t> exif;
  for (std::size_t first = 0; first < bytes.size(); first += file.entry_bytes()) {
    const Bytes entry = Bytes(bytes).subspan(first, file.entry_bytes());
    check_entry(file, entry);
    if (file.tag(entry) == kExif) exif = place_in(file, entry);
  }
  return exif;
}

}  // namespace

void check_tiff(const fs::path& path, std::uintmax_t file_bytes, std::uint64_t directory) {
  const TiffFile file = tiff_file(path, file_bytes);
  if (const auto exif = check_directory(file, directory, "directory"))
    check_directory(file, *exif, "exposure (Exif)");
}

}  // namespace malus::internal
