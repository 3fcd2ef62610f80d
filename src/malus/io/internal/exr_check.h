// The headers of an EXR file (OpenEXR file layout): OpenEXR takes the memory that a value claims to
// need before it reads the value, 2 GB for a damaged length, so lengths are looked at before.
#pragma once

#include <cstdint>
#include <filesystem>

namespace malus::internal {

/// Throws InputError unless every value of the headers, and every text of a list, ends inside the
/// file.
void check_exr(const std::filesystem::path& path, std::uintmax_t file_bytes);

}  // namespace malus::internal
