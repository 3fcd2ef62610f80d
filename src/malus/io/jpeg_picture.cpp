#include "malus/io/internal/jpeg_picture.h"

#include "malus/io/internal/interleaved.h"
#include "malus/io/internal/jpeg_check.h"
#include "malus/io/internal/picture_faults.h"

#include <memory>
#include <new>
#include <type_traits>
#include <vector>

#include <turbojpeg.h>

namespace malus::internal {
namespace {

struct DestroyJpeg {
  void operator()(void* decoder) const { tjDestroy(decoder); }
};

}  // namespace

Decoded read_jpeg(const std::filesystem::path& path, std::uintmax_t file_bytes) {
  const auto file = read_bytes(path);
  const JpegSize size = check_jpeg(file, path);
  check_plausible(path, file_bytes, size.rows, size.cols, size.channels, 8);
  const std::unique_ptr<std::remove_pointer_t<tjhandle>, DestroyJpeg> decoder(tjInitDecompress());
  if (!decoder) throw std::bad_alloc();
  const auto channels = static_cast<std::size_t>(size.channels);
  std::vector<unsigned char> pixels(static_cast<std::size_t>(size.rows) *
                                    static_cast<std::size_t>(size.cols) * channels);
  // What is missing or damaged is a mere warning otherwise.
  if (tjDecompress2(decoder.get(), file.data(), file.size(), pixels.data(), size.cols, 0, size.rows,
                    size.channels == 1 ? TJPF_GRAY : TJPF_RGB,
                    TJFLAG_STOPONWARNING | TJFLAG_ACCURATEDCT) != 0)
    unreadable_picture(path, tjGetErrorStr2(decoder.get()));

  Decoded decoded;
  decoded.format = "jpeg";
  decoded.sample = "uint8";
  decoded.bits = 8;
  decoded.rows = size.rows;
  decoded.cols = size.cols;
  decoded.channels = size.channels;
  decoded.planes = Planes(size.channels, size.rows, size.cols);
  const std::size_t row_bytes = static_cast<std::size_t>(size.cols) * channels;
  for (int r = 0; r < size.rows; ++r) {
    const unsigned char* const row = pixels.data() + static_cast<std::size_t>(r) * row_bytes;
    take_interleaved({r, 0, size.cols, 0, size.channels}, decoded.planes,
                     [&](std::size_t i) { return row[i]; });
  }
  return decoded;
}

}  // namespace malus::internal
