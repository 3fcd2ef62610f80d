#include "malus/io/internal/picture_codec.h"

#include "malus/base/error.h"
#include "malus/io/internal/bmp_picture.h"
#include "malus/io/internal/exr_picture.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/jpeg_picture.h"
#include "malus/io/internal/picture_output.h"
#include "malus/io/internal/png_picture.h"
#include "malus/io/internal/tiff_picture.h"

namespace malus::internal {

namespace fs = std::filesystem;

Decoded read_picture(const fs::path& path, const std::string& codec, bool pixels,
                     std::uint64_t directory) {
  const std::uintmax_t file_bytes = require_file(path);
  if (codec == "tiff") return read_tiff(path, file_bytes, directory, pixels);
  if (codec == "png") return read_png(path, pixels);
  if (codec == "openexr") return read_exr(path, file_bytes, pixels);
  if (codec == "bmp") return read_bmp(path, file_bytes, pixels);
  MALUS_REQUIRE(codec == "jpeg");
  return read_jpeg(path, file_bytes);
}

void write_picture(const fs::path& path, bool force, const std::string& codec,
                   std::span<const Image> planes, const std::vector<std::string>& names,
                   SampleType type, const std::string& description,
                   std::optional<double> exposure_s) {
  write_encoded(path, force, [&](PictureOutput& output) {
    if (codec == "tiff") return encode_tiff(output, path, planes, type, description);
    if (codec == "png") return encode_png(output, path, planes, type, description);
    MALUS_REQUIRE(codec == "openexr");
    encode_exr(output, path, planes, names, type, description, exposure_s);
  });
}

}  // namespace malus::internal
