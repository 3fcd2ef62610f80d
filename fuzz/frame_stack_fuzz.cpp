// links: malus_io
#include "malus/io/internal/fits.h"
#include "malus/io/internal/npy.h"
#include "malus/io/internal/tiff_check.h"
#include "malus/io/internal/tiff_frames.h"

#include <initializer_list>
#include <string>

#include "target.h"
#include <sys/mman.h>
#include <unistd.h>

namespace {

// Stacks are read from files, frame by frame: this one lies in memory.
class MemoryFile {
 public:
  explicit MemoryFile(std::span<const std::uint8_t> bytes) : file_(::memfd_create("stack", 0)) {
    for (std::size_t done = 0; done < bytes.size();) {
      const ssize_t written = ::write(file_, bytes.data() + done, bytes.size() - done);
      if (written <= 0) __builtin_trap();
      done += static_cast<std::size_t>(written);
    }
  }
  ~MemoryFile() { ::close(file_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  std::filesystem::path path() const { return "/proc/self/fd/" + std::to_string(file_); }

 private:
  int file_;
};

}  // namespace

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
