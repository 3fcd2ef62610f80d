// A TIFF file's numbers and the entries of its directories (TIFF 6.0, section 2; BigTIFF).
#pragma once

#include "malus/io/internal/file_bytes.h"

#include <string_view>

namespace malus::internal {

/// One file's way of writing numbers, and its size.
struct TiffFile {
  const std::filesystem::path& path;
  std::uint64_t file_bytes;
  bool big_endian, big_tiff;
  std::uint64_t first_directory;  ///< its place in the file

  /// A place in the file, or the number of values: 4 bytes, of BigTIFF 8.
  std::uint64_t number(Bytes bytes, std::size_t at) const {
    return big_tiff ? load_number<std::uint64_t>(bytes, at, big_endian)
                    : load_number<std::uint32_t>(bytes, at, big_endian);
  }
  std::uint64_t number_bytes() const { return big_tiff ? 8 : 4; }
  /// Bytes of a directory's entry: tag, type, number of values, the values or their place.
  std::size_t entry_bytes() const { return static_cast<std::size_t>(4 + 2 * number_bytes()); }
  bool within(std::uint64_t at, std::uint64_t bytes) const {
    return at <= file_bytes && bytes <= file_bytes - at;
  }
  std::uint16_t tag(Bytes entry) const { return load_number<std::uint16_t>(entry, 0, big_endian); }
  std::uint16_t type(Bytes entry) const { return load_number<std::uint16_t>(entry, 2, big_endian); }
};

/// The first directory of all. `path` has to outlive what is returned. Throws InputError where the
/// file ends before.
TiffFile tiff_file(const std::filesystem::path& path, std::uintmax_t file_bytes);

/// The entries of the directory at `at`, one after the other. Throws InputError unless all lie
/// within the file; `name` is what the directory is called then.
std::vector<std::uint8_t> tiff_entries(const TiffFile& file, std::uint64_t at,
                                       std::string_view name);

/// The entry's first `most` values; none unless they are whole numbers that lie within the file.
std::vector<std::uint64_t> tiff_values(const TiffFile& file, Bytes entry, std::uint64_t most);

}  // namespace malus::internal
