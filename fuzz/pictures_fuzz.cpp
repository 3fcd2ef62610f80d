// links: malus_io
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/picture_codec.h"
#include "malus/io/internal/tiff_frames.h"

#include "memory_file.h"
#include "target.h"

// What the libraries make of a file is their affair; what we make of the sizes, types and rows that
// they hand over is ours.
void parse_bytes(std::span<const std::uint8_t> bytes) {
  using namespace malus::internal;
  const MemoryFile file(bytes);
  const auto path = file.path();
  if (begins_with(bytes, "II") || begins_with(bytes, "MM")) {
    const TiffFramePlaces places = tiff_frames(path);
    for (const std::uint64_t place : *places) (void)read_picture(path, "tiff", true, place);
  } else if (begins_with(bytes, "BM")) {
    (void)read_picture(path, "bmp", true, kNoDirectory);
  } else if (begins_with(bytes, "\x89PNG")) {
    (void)read_picture(path, "png", true, kNoDirectory);
  } else if (begins_with(bytes, "v/1\x01")) {
    (void)read_picture(path, "openexr", true, kNoDirectory);
  } else {
    (void)read_picture(path, "jpeg", true, kNoDirectory);
  }
}
