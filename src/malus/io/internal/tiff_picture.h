// TIFF through libtiff, values as stored.
#pragma once

#include "malus/image/view.h"
#include "malus/io/internal/decoded.h"
#include "malus/io/internal/picture_output.h"
#include "malus/io/picture_file.h"

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

namespace malus::internal {

/// The picture of the directory at this place; palettes and YCbCr come as RGB of 8 bits. Throws
/// InputError when damaged, cut off or of several planes of depth.
Decoded read_tiff(const std::filesystem::path& path, std::uintmax_t file_bytes,
                  std::uint64_t directory, bool pixels);

/// Uncompressed: noise does not shrink, nor do floats that it was taken out of (by 5 %), and every
/// tool reads it at once. Without a date, so the same picture gives the same bytes. path: for
/// messages. Throws InputError where libtiff refuses; what cannot be written output tells.
void encode_tiff(PictureOutput& output, const std::filesystem::path& path,
                 std::span<const Image> planes, SampleType type, const std::string& description);

}  // namespace malus::internal
