// The frame of a JPEG file (ITU-T T.81, annex B): decoders reserve memory for the size that a file
// declares, and fill what is cut off with grey, so both are looked at before.
#pragma once

#include "malus/io/internal/file_bytes.h"

#include <filesystem>

namespace malus::internal {

/// What a JPEG file declares.
struct JpegSize {
  int rows = 0, cols = 0, channels = 0;
};

/// Whether a file's first bytes are those of JPEG.
bool begins_as_jpeg(Bytes bytes);

/// Throws InputError unless every segment is whole up to the end marker, and the picture is one of
/// 8 bits in one channel (grey) or three, in no more scans than encoders write.
JpegSize check_jpeg(Bytes bytes, const std::filesystem::path& path);

}  // namespace malus::internal
