// links: malus_io
#include "malus/io/internal/fits.h"
#include "malus/io/internal/npy.h"
#include "malus/io/internal/tiff_check.h"
#include "malus/io/internal/tiff_frames.h"

#include <initializer_list>

#include "memory_file.h"
#include "target.h"

// Stacks are read from files, frame by frame.
void parse_bytes(std::span<const std::uint8_t> bytes) {
  using namespace malus::internal;
  const MemoryFile file(bytes);
  const auto path = file.path();
  if (begins_as_npy(bytes)) {
    const int frames = npy_frames(path);
    for (const int frame : {0, frames / 2, frames - 1}) (void)read_npy(path, true, frame);
  } else if (begins_as_fits(bytes)) {
    const int frames = fits_frames(path);
    for (const int frame : {0, frames / 2, frames - 1}) (void)read_fits(path, true, frame);
  } else {
    const TiffFramePlaces places = tiff_frames(path);
    for (const std::uint64_t place : *places) check_tiff(path, bytes.size(), place);
  }
}
