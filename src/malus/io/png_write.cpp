#include "malus/base/error.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/interleaved.h"
#include "malus/io/internal/picture_faults.h"
#include "malus/io/internal/png_message.h"
#include "malus/io/internal/png_picture.h"

#include <array>
#include <cstdint>
#include <vector>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

void write_png_bytes(png_structp png, png_bytep bytes, std::size_t size) {
  auto& output = *static_cast<PictureOutput*>(png_get_io_ptr(png));
  if (output.write(bytes, size) != size) png_error(png, "the file cannot be written");
}

void flush_png(png_structp) {}

struct PngShape {
  png_uint_32 rows, cols;
  int bits, colour_type;
};

// False: the message says why.
bool write_png_head(png_structp png, png_infop info, const PngShape& shape, png_textp description) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_user_limits(png, PNG_UINT_31_MAX, PNG_UINT_31_MAX);
  png_set_compression_level(png, 3);
  png_set_IHDR(png, info, shape.cols, shape.rows, shape.bits, shape.colour_type, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  if (description != nullptr) png_set_text(png, info, description, 1);
  png_write_info(png, info);
  if (shape.bits == 16 && !kBigEndianMachine) png_set_swap(png);
  return true;
}

bool write_png_row(png_structp png, const void* row) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_write_row(png, static_cast<png_const_bytep>(row));
  return true;
}

bool end_png(png_structp png) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_write_end(png, nullptr);
  return true;
}

template <class T>
bool write_png_rows(png_structp png, std::span<const Image> planes) {
  for (int r = 0; r < planes[0].rows(); ++r)
    if (!write_png_row(png, interleaved_rows<T>(planes, r, r + 1).data())) return false;
  return true;
}

}  // namespace

void encode_png(PictureOutput& output, const fs::path& path, std::span<const Image> planes,
                SampleType type, const std::string& description) {
  constexpr std::array<int, 4> kColourTypes = {PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA,
                                               PNG_COLOR_TYPE_RGB, PNG_COLOR_TYPE_RGB_ALPHA};
  MALUS_REQUIRE(planes.size() <= kColourTypes.size());
  const bool wide = type == SampleType::kUint16;
  const PngShape shape{static_cast<png_uint_32>(planes[0].rows()),
                       static_cast<png_uint_32>(planes[0].cols()), wide ? 16 : 8,
                       kColourTypes[planes.size() - 1]};
  std::string key = "Description", text = description;
  png_text entry{};
  entry.compression = PNG_TEXT_COMPRESSION_NONE;
  entry.key = key.data();
  entry.text = text.data();
  entry.text_length = text.size();

  PngWriter writer;
  png_set_write_fn(writer.png, &output, write_png_bytes, flush_png);
  const bool good =
      write_png_head(writer.png, writer.info, shape, text.empty() ? nullptr : &entry) &&
      (wide ? write_png_rows<std::uint16_t>(writer.png, planes)
            : write_png_rows<std::uint8_t>(writer.png, planes)) &&
      end_png(writer.png);
  if (!good) unwritable_picture(path, writer.message.text);
}

}  // namespace malus::internal
