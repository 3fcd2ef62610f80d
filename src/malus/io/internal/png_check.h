// The frame of a PNG file (PNG specification, 5.3 and 11): libpng passes over damage of chunks that
// it can do without, as the one that tells what the frame is, so damage is found before it looks.
#pragma once

#include "malus/io/internal/file_bytes.h"

#include <cstdint>
#include <filesystem>

namespace malus::internal {

/// Throws InputError unless the signature, every chunk's length and checksum, and the end are
/// whole.
void check_png(Bytes bytes, const std::filesystem::path& path);

}  // namespace malus::internal
