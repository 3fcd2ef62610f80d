// The pixels of a TIFF file that are compressed by Deflate: libtiff stops before the checksum.
#pragma once

#include <cstdint>
#include <filesystem>

namespace malus::internal {

/// Throws InputError unless each strip or tile of the directory at this place is a whole Deflate
/// stream with the right checksum, as long as its pixels need (the last strip may be longer). Other
/// compressions pass. Contract: check_tiff has passed.
void check_deflated(const std::filesystem::path& path, std::uintmax_t file_bytes,
                    std::uint64_t directory);

}  // namespace malus::internal
