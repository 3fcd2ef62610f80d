#include "malus/io/internal/png_picture.h"

#include "malus/base/error.h"
#include "malus/io/internal/exif.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/interleaved.h"
#include "malus/io/internal/picture_faults.h"
#include "malus/io/internal/png_check.h"
#include "malus/io/internal/png_message.h"

#include <cstring>
#include <string_view>
#include <vector>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

// Where libpng reads from.
struct PngBytes {
  Bytes left;

  static void read(png_structp png, png_bytep to, std::size_t size) {
    auto& bytes = *static_cast<PngBytes*>(png_get_io_ptr(png));
    if (size > bytes.left.size()) png_error(png, "it ends too early");
    std::memcpy(to, bytes.left.data(), size);
    bytes.left = bytes.left.subspan(size);
  }
};

// Everything up to the pixels, how they are wanted, and the bits that they have then. False: the
// message says why.
bool read_png_head(png_structp png, png_infop info, int* bits) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_user_limits(png, PNG_UINT_31_MAX, PNG_UINT_31_MAX);
  png_read_info(png, info);
  const bool has_palette = png_get_color_type(png, info) == PNG_COLOR_TYPE_PALETTE;
  const bool has_transparency = png_get_valid(png, info, PNG_INFO_tRNS) != 0;
  *bits = png_get_bit_depth(png, info);
  if (*bits < 8 && (has_palette || has_transparency)) *bits = 8;
  if (has_palette) png_set_palette_to_rgb(png);
  if (has_transparency) png_set_tRNS_to_alpha(png);
  png_set_packing(png);  // 1, 2 and 4 bits in a byte each, as they are
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
  return true;
}

bool read_png_rows(png_structp png, png_infop info, png_bytepp rows) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_read_image(png, rows);
  png_read_end(png, info);
  return true;
}

void read_png_pixels(const fs::path& path, PngReader& reader, Decoded& decoded) {
  const std::size_t row_bytes = png_get_rowbytes(reader.png, reader.info);
  std::vector<std::uint8_t> bytes(row_bytes * static_cast<std::size_t>(decoded.rows));
  std::vector<png_bytep> rows;
  for (int r = 0; r < decoded.rows; ++r)
    rows.push_back(bytes.data() + static_cast<std::size_t>(r) * row_bytes);
  if (!read_png_rows(reader.png, reader.info, rows.data()))
    unreadable_picture(path, reader.message.text);
  decoded.planes = Planes(decoded.channels, decoded.rows, decoded.cols);
  for (int r = 0; r < decoded.rows; ++r) {
    const Bytes row = Bytes(bytes).subspan(static_cast<std::size_t>(r) * row_bytes, row_bytes);
    const RowPart part{r, 0, decoded.cols, 0, decoded.channels};
    if (decoded.bits == 16)
      take_interleaved(part, decoded.planes,
                       [&](std::size_t i) { return load_number<std::uint16_t>(row, 2 * i, true); });
    else
      take_interleaved(part, decoded.planes, [&](std::size_t i) { return row[i]; });
  }
}

std::string description_in(png_structp png, png_infop info) {
  png_textp texts = nullptr;
  int count = 0;
  png_get_text(png, info, &texts, &count);
  for (int i = 0; i < count; ++i)
    if (std::string_view(texts[i].key) == "Description" && texts[i].text != nullptr)
      return texts[i].text;
  return {};
}

// A TIFF structure in a chunk of its own. What stands behind the last chunk, whose lengths nobody
// has checked, is none of the picture. Contract: check_png.
ExifFacts exif_in(const fs::path& path, Bytes file) {
  constexpr std::string_view kChunk = "eXIf", kLast = "IEND";
  constexpr std::size_t kSignature = 8, kFrame = 12;
  for (std::size_t at = kSignature; !begins_with(file.subspan(at + 4), kLast);) {
    const auto length = load_number<std::uint32_t>(file, at, true);
    if (begins_with(file.subspan(at + 4), kChunk)) try {
        const TiffFile exif = tiff_file(path, length, at + 8);
        return exif_facts(exif, exif.first_directory);
      } catch (const InputError&) {
        return {};  // it is beside the pixels
      }
    at += kFrame + length;
  }
  return {};
}

}  // namespace

Decoded read_png(const fs::path& path, bool pixels) {
  const auto file = read_bytes(path);
  check_png(file, path);
  PngReader reader;
  PngBytes bytes{file};
  png_set_read_fn(reader.png, &bytes, PngBytes::read);
  Decoded decoded;
  if (!read_png_head(reader.png, reader.info, &decoded.bits))
    unreadable_picture(path, reader.message.text);
  decoded.format = "png";
  decoded.sample = decoded.bits == 16 ? "uint16" : "uint8";
  decoded.channels = png_get_channels(reader.png, reader.info);
  check_plausible(path, file.size(), png_get_image_height(reader.png, reader.info),
                  png_get_image_width(reader.png, reader.info), decoded.channels, decoded.bits);
  decoded.rows = static_cast<int>(png_get_image_height(reader.png, reader.info));
  decoded.cols = static_cast<int>(png_get_image_width(reader.png, reader.info));
  if (decoded.channels == 2) decoded.names = {"Y", "A"};
  decoded.description = description_in(reader.png, reader.info);
  const ExifFacts exif = exif_in(path, file);
  decoded.camera = exif.camera;
  decoded.exposure_s = exif.exposure_s;
  decoded.gain.iso = exif.iso;
  if (pixels) read_png_pixels(path, reader, decoded);
  return decoded;
}

}  // namespace malus::internal
