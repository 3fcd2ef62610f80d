// EXR through OpenEXR.
#pragma once

#include "malus/image/view.h"
#include "malus/io/internal/decoded.h"
#include "malus/io/internal/picture_output.h"
#include "malus/io/picture_file.h"

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace malus::internal {

/// The pixels of the data window. Channels come as R, G, B, A, or X, Y, Z, others by their names.
/// Throws InputError when damaged, of several parts, deep, or with channels of integers or fewer
/// pixels.
Decoded read_exr(const std::filesystem::path& path, std::uintmax_t file_bytes, bool pixels);

/// Uncompressed, as encode_tiff says. path: for messages. Throws InputError where OpenEXR refuses;
/// what cannot be written output tells.
void encode_exr(PictureOutput& output, const std::filesystem::path& path,
                std::span<const Image> planes, const std::vector<std::string>& names,
                SampleType type, const std::string& description, std::optional<double> exposure_s);

}  // namespace malus::internal
