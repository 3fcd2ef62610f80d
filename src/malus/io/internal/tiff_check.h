// The directory of a TIFF file (TIFF 6.0, section 2; BigTIFF): libtiff leaves out what lies behind
// the end of a file that was cut off, and such a file would be read as one that never told it.
#pragma once

#include <cstdint>
#include <filesystem>

namespace malus::internal {

/// Throws InputError unless the directory at this place, that of the exposure (Exif) and all that
/// they point to lie within the file. Pixels are not looked at, nor values of unknown types.
void check_tiff(const std::filesystem::path& path, std::uintmax_t file_bytes,
                std::uint64_t directory);

}  // namespace malus::internal
