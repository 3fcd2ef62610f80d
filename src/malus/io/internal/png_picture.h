// PNG through libpng, values as stored.
#pragma once

#include "malus/image/view.h"
#include "malus/io/internal/decoded.h"
#include "malus/io/internal/picture_output.h"
#include "malus/io/picture_file.h"

#include <filesystem>
#include <span>
#include <string>

namespace malus::internal {

/// Palettes come as their colours, transparency as a further channel. Throws InputError when
/// damaged or cut off.
Decoded read_png(const std::filesystem::path& path, bool pixels);

/// Integers of 1 to 4 channels. Without a date, so the same picture gives the same bytes. path: for
/// messages. Throws InputError where libpng refuses; what cannot be written output tells.
void encode_png(PictureOutput& output, const std::filesystem::path& path,
                std::span<const Image> planes, SampleType type, const std::string& description);

}  // namespace malus::internal
