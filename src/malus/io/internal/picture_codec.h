// TIFF, PNG, EXR, BMP and JPEG, values as stored.
#pragma once

#include "malus/image/view.h"
#include "malus/io/internal/decoded.h"
#include "malus/io/picture_file.h"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace malus::internal {

/// The file's type by its first bytes ("tiff", "png", "openexr"), or empty.
/// TIFF is recognised only with the ending .tif or .tiff: camera raws begin like one. JPEG is not:
/// nothing that is measured is read from it.
std::string picture_codec(const std::filesystem::path& path);

/// The directory of files that have none.
inline constexpr std::uint64_t kNoDirectory = 0;
/// codec: of picture_codec, or "jpeg". directory: the place of that to be read in a TIFF file
/// (tiff_frames.h), whose others are not looked at. Throws InputError when damaged, of several
/// parts, or too large.
Decoded read_picture(const std::filesystem::path& path, const std::string& codec, bool pixels,
                     std::uint64_t directory);

/// Writes the whole file or throws InputError; nothing half-written remains. Integers by
/// stored_value. Contract: at least one plane.
void write_picture(const std::filesystem::path& path, bool force, const std::string& codec,
                   std::span<const Image> planes, const std::vector<std::string>& names,
                   SampleType type, const std::string& description,
                   std::optional<double> exposure_s);

}  // namespace malus::internal
