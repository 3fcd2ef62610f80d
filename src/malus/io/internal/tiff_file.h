// A TIFF file's numbers and the entries of its directories (TIFF 6.0, section 2; BigTIFF).
#pragma once

#include "malus/io/internal/file_bytes.h"

#include <initializer_list>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace malus::internal {

/// One file's way of writing numbers, and its size.
struct TiffFile {
  const std::filesystem::path& path;
  std::uint64_t file_bytes;
  bool big_endian, big_tiff;
  std::uint64_t first_directory;  ///< its place; all places are told from `base` on
  std::uintmax_t base = 0;        ///< where it begins in the file, as one within another does

  /// A place in the file, or the number of values: 4 bytes, of BigTIFF 8.
  std::uint64_t number(Bytes bytes, std::size_t at) const {
    return big_tiff ? load_number<std::uint64_t>(bytes, at, big_endian)
                    : load_number<std::uint32_t>(bytes, at, big_endian);
  }
  std::uint64_t number_bytes() const { return big_tiff ? 8 : 4; }
  /// Where the header keeps the place of the first directory.
  std::uint64_t link_at() const { return big_tiff ? 8 : 4; }
  /// Bytes of a directory's entry: tag, type, number of values, the values or their place.
  std::size_t entry_bytes() const { return static_cast<std::size_t>(4 + 2 * number_bytes()); }
  bool within(std::uint64_t at, std::uint64_t bytes) const {
    return at <= file_bytes && bytes <= file_bytes - at;
  }
  std::uint16_t tag(Bytes entry) const { return load_number<std::uint16_t>(entry, 0, big_endian); }
  std::uint16_t type(Bytes entry) const { return load_number<std::uint16_t>(entry, 2, big_endian); }
};

/// `path` has to outlive what is returned. Throws InputError where the file ends before the first
/// directory's place. base: where it begins within the file at `path`.
TiffFile tiff_file(const std::filesystem::path& path, std::uintmax_t file_bytes,
                   std::uintmax_t base = 0);

/// Throws InputError: the file ends before its `what`.
[[noreturn]] void cut_tiff(const std::filesystem::path& path, std::string_view what);

/// Bytes of one value by its type's number; 0 of unknown ones.
std::uint64_t bytes_of_tiff_type(std::uint16_t type);

struct TiffEntries {
  std::vector<std::uint8_t> bytes;  ///< one entry after the other
  std::uint64_t next;               ///< place of the next directory; 0 after the last
};

/// The entries of the directory at `at`. Throws InputError unless all lie within the file; `name`
/// is what the directory is called then.
TiffEntries tiff_entries(const TiffFile& file, std::uint64_t at, std::string_view name);

enum TiffTag : std::uint16_t {
  kSubfile = 254,
  kOldSubfile = 255,
  kCols = 256,
  kRows = 257,
  kBits = 258,
  kCompression = 259,
  kPhotometric = 262,
  kDescription = 270,
  kCamera = 272,
  kStripPlaces = 273,
  kSamples = 277,
  kRowsPerStrip = 278,
  kStripBytes = 279,
  kPlanar = 284,
  kTileCols = 322,
  kTileRows = 323,
  kTilePlaces = 324,
  kTileBytes = 325,
  kSampleFormat = 339,
  kExposure = 33434,
  kExif = 34665,
  kIso = 34855,
  kRecommendedExposureIndex = 34866,
  kIsoSpeed = 34867
};

/// A directory's values by their tags.
class TiffTags {
 public:
  /// As tiff_entries; file has to outlive it.
  TiffTags(const TiffFile& file, std::uint64_t at, std::string_view name);
  bool has(TiffTag tag) const { return at_.contains(tag); }
  /// The tag's first `most` values; none unless it is there and they are whole numbers that lie
  /// within the file.
  std::vector<std::uint64_t> all(TiffTag tag, std::uint64_t most) const;
  std::uint64_t one(TiffTag tag, std::uint64_t otherwise) const;
  /// The first `most` characters; none unless it is a text that lies within the file.
  std::string text(TiffTag tag, std::uint64_t most) const;
  /// A number with a fraction.
  std::optional<double> rational(TiffTag tag) const;
  std::uint64_t next() const { return entries_.next; }

 private:
  Bytes entry(std::size_t at) const {
    return Bytes(entries_.bytes).subspan(at, file_.entry_bytes());
  }
  struct Values {
    std::vector<std::uint8_t> bytes;
    std::size_t each = 0;  // bytes of one
  };
  Values values(TiffTag tag, std::initializer_list<std::uint16_t> types, std::uint64_t most) const;

  const TiffFile& file_;
  TiffEntries entries_;
  std::map<std::uint16_t, std::size_t> at_;
};

}  // namespace malus::internal
